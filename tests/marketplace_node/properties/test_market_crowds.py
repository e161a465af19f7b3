# SPDX-License-Identifier: Apache-2.0
"""A thousand scenes among hosts that die, stay silent or are slow: each ends exactly once."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from bt_agents_core.errors import Refused
from market_harness import MarketHarness
from marketplace_node.effects import AnnounceRun, Collect, OpenCall, SendGoal, State
from marketplace_node.hosts.host_effects import CancelGoal, Effect, RunGoal
from marketplace_node.outcomes import RunEventKind

AGENTS = {"/a": ("ann", "abe"), "/b": ("bob", "bea"), "/c": ("cat", "cem")}
SCENES = 1000
VALUES = (1.0, 2.5, 3.0, 5.0)


class Crowd:
    """Plays hosts, people and the feedback node at random, with a seed."""

    def __init__(self, mode: str, seed: int) -> None:
        self.random = random.Random(seed)
        self.harness = MarketHarness(
            on_new_scene=mode, queue_limit=4, preempt_cooldown_s=0.5, collect_deadline_s=0.25
        )
        self.seen = 0
        self.calls: list[OpenCall] = []
        self.goals: list[RunGoal] = []
        self.running: set[RunGoal] = set()
        self.told: list[RunGoal] = []
        self.on_stage: RunGoal | None = None
        self.starts = 0
        self.down: dict[str, float] = {}
        self.sent: Counter[str] = Counter()
        for host, agents in AGENTS.items():
            self.harness.register(host, *agents, instance="start0")

    def chance(self, part: float) -> bool:
        return self.random.random() < part

    def step(self) -> None:
        self.hosts_live_and_die()
        self.hosts_answer()
        self.trees_go_on()
        if self.chance(0.04):
            self.harness.cancel("enough", again=self.chance(0.5))
        self.harness.wait(1 / 16)
        self.take_effects()

    def scene(self, number: int) -> None:
        name = f"s{number}"
        if self.chance(0.02):
            name = f"s{max(0, number - 1)}"
        self.sent[name] += 1
        if self.chance(0.02):
            refused = Refused("NOT_FINITE", "age is nan")
            self.harness.do(self.harness.market.malformed(name, refused, self.harness.now))
        else:
            self.harness.scene(name, urgent=self.chance(0.1))
        self.take_effects()

    def take_effects(self) -> None:
        news, self.seen = self.harness.effects[self.seen :], len(self.harness.effects)
        for effect in news:
            self.take(effect)

    def take(self, effect: Effect) -> None:
        match effect:
            case OpenCall():
                self.calls.append(effect)
            case SendGoal():
                self.goals.append(effect.goal)
            case CancelGoal():
                self.told.append(effect.goal)
            case Collect() if self.chance(0.5):
                number = effect.goal.round
                self.harness.do(self.harness.market.collected(number, "learned", self.harness.now))
            case AnnounceRun(event=RunEventKind.STARTED):
                assert self.on_stage is None, "never two runs at a time"
                self.on_stage = effect.goal
            case AnnounceRun(event=RunEventKind.ENDED) if effect.goal == self.on_stage:
                self.on_stage = None
            case _:
                pass

    def hosts_live_and_die(self) -> None:
        for host, agents in AGENTS.items():
            if host in self.down:
                if self.harness.now >= self.down[host]:
                    del self.down[host]
                    self.starts += 1
                    answer = self.harness.register(host, *agents, instance=f"start{self.starts}")
                    if not answer.accepted:
                        self.down[host] = self.harness.now + 0.5
            elif self.chance(0.01):
                self.down[host] = self.harness.now + self.random.uniform(0.2, 2.0)
                self.harness.busy.pop(host, None)
                self.running = {goal for goal in self.running if goal.host != host}
        self.take_effects()

    def hosts_answer(self) -> None:
        calls, self.calls = self.calls, []
        for call in calls:
            for host, agents in AGENTS.items():
                if host in self.down or self.chance(0.05):
                    continue  # silent
                vectors = {name: tuple(self.random.choices(VALUES, k=3)) for name in agents}
                declined = {}
                if self.chance(0.1):
                    declined = dict.fromkeys(agents, "is tired")
                    vectors = {}
                self.harness.bid(host, vectors, declined, round=call.round)
        goals, self.goals = self.goals, []
        for goal in goals:
            if goal.host in self.down or self.chance(0.03):
                continue  # never answered
            if self.chance(0.1) or self.harness.busy.get(goal.host):
                self.harness.refuse(goal)
            elif self.chance(0.1):
                self.goals.append(goal)  # answered later
            else:
                self.running.add(goal)
                self.harness.accept(goal)
        self.take_effects()

    def trees_go_on(self) -> None:
        told, self.told = self.told, []
        for goal in told:
            if goal in self.running and self.chance(0.9):
                self.finish(goal, 3)
        for goal in list(self.running):
            if self.chance(0.3):
                self.finish(goal, self.random.choice((1, 1, 2)))
        self.take_effects()

    def finish(self, goal: RunGoal, outcome: int) -> None:
        self.running.discard(goal)
        self.harness.end(outcome, goal=goal)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("mode", ["queue", "reject", "preempt"])
def test_each_of_thousand_scenes_ends_exactly_once(mode: str, seed: int) -> None:
    crowd = Crowd(mode, seed)
    number = 0
    while number < SCENES:
        for _ in range(crowd.random.choice((*[0] * 24, 1, 1, 1, 5))):
            if number < SCENES:
                crowd.scene(number)
                number += 1
        crowd.step()
    for _ in range(2000):
        if crowd.harness.status.state is State.IDLE:
            break
        crowd.step()

    status = crowd.harness.status
    assert (status.state, status.queued) == (State.IDLE, 0), "nothing waits for ever"
    assert sum(crowd.sent.values()) == SCENES
    assert Counter(crowd.harness.over) == crowd.sent, "taken = ended, each as often as it came"
    codes = Counter(code for _, code in crowd.harness.ends)
    assert sum(codes.values()) == SCENES
    expected = {"SUCCEEDED", "FAILED", "CANCELLED", "LOST", "NOT_FINITE", "STOPPED"}
    expected |= {"reject": {"BUSY"}, "queue": {"QUEUE_FULL"}, "preempt": {"PREEMPTED"}}[mode]
    assert expected <= codes.keys(), codes
