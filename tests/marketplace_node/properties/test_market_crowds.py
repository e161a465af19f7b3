# SPDX-License-Identifier: Apache-2.0
"""A thousand scenes among hosts that die, stay silent and dawdle: each one ends exactly once."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from bt_agents_core.errors import Refused
from market_harness import Driver
from marketplace_node.effects import AnnounceRun, Collect, OpenCall, SendGoal, State
from marketplace_node.hosts.host_effects import CancelGoal, Effect, RunGoal
from marketplace_node.outcomes import RunEventKind

AGENTS = {"/a": ("ann", "abe"), "/b": ("bob", "bea"), "/c": ("cat", "cem")}
SCENES = 1000
VALUES = (1.0, 2.5, 3.0, 5.0)


class Crowd:
    """Plays hosts, people and the feedback node at random, from a seed."""

    def __init__(self, mode: str, seed: int) -> None:
        self.random = random.Random(seed)
        self.driver = Driver(
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
            self.driver.register(host, *agents, instance="start0")

    def chance(self, part: float) -> bool:
        return self.random.random() < part

    def step(self) -> None:
        self.hosts_live_and_die()
        self.hosts_answer()
        self.trees_go_on()
        if self.chance(0.04):
            self.driver.cancel("enough", again=self.chance(0.5))
        self.driver.wait(1 / 16)
        self.take_effects()

    def scene(self, number: int) -> None:
        name = f"s{number}"
        if self.chance(0.02):
            name = f"s{max(0, number - 1)}"
        self.sent[name] += 1
        if self.chance(0.02):
            refused = Refused("NOT_FINITE", "age is nan")
            self.driver.do(self.driver.market.malformed(name, refused, self.driver.now))
        else:
            self.driver.scene(name, urgent=self.chance(0.1))
        self.take_effects()

    def take_effects(self) -> None:
        news, self.seen = self.driver.effects[self.seen :], len(self.driver.effects)
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
                self.driver.do(self.driver.market.collected(number, "learned", self.driver.now))
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
                if self.driver.now >= self.down[host]:
                    del self.down[host]
                    self.starts += 1
                    answer = self.driver.register(host, *agents, instance=f"start{self.starts}")
                    if not answer.accepted:
                        self.down[host] = self.driver.now + 0.5
            elif self.chance(0.01):
                self.down[host] = self.driver.now + self.random.uniform(0.2, 2.0)
                self.driver.busy.pop(host, None)
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
                self.driver.bid(host, vectors, declined, round=call.round)
        goals, self.goals = self.goals, []
        for goal in goals:
            if goal.host in self.down or self.chance(0.03):
                continue  # never answered
            if self.chance(0.1) or self.driver.busy.get(goal.host):
                self.driver.refuse(goal)
            elif self.chance(0.1):
                self.goals.append(goal)  # answered later
            else:
                self.running.add(goal)
                self.driver.accept(goal)
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
        self.driver.end(outcome, goal=goal)


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
        if crowd.driver.status.state is State.IDLE:
            break
        crowd.step()

    status = crowd.driver.status
    assert (status.state, status.queued) == (State.IDLE, 0), "nothing waits for ever"
    assert sum(crowd.sent.values()) == SCENES
    assert Counter(crowd.driver.over) == crowd.sent, "taken = ended, each as often as it came"
    codes = Counter(code for _, code in crowd.driver.ends)
    assert sum(codes.values()) == SCENES
    expected = {"SUCCEEDED", "FAILED", "CANCELLED", "LOST", "NOT_FINITE", "STOPPED"}
    expected |= {"reject": {"BUSY"}, "queue": {"QUEUE_FULL"}, "preempt": {"PREEMPTED"}}[mode]
    assert expected <= codes.keys(), codes
