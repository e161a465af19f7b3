# SPDX-License-Identifier: Apache-2.0
"""Laws of the market: one tree at a time, one end per scene, and rest in the end."""

from __future__ import annotations

import random
from collections import Counter
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import OpenGoal
from market_harness import MarketHarness, scene
from marketplace_node.effects import (
    AnnounceRun,
    Collect,
    OpenCall,
    PreviewEnded,
    PublishAuction,
    RequestRanking,
    SendGoal,
    State,
)
from marketplace_node.hosts.host_effects import CancelGoal, CancelOpenGoals, Effect, RunGoal
from marketplace_node.market_state import PREVIEWS
from marketplace_node.operator_overrides import OperatorAction
from marketplace_node.operators import MOST_PREVIEWS
from marketplace_node.outcomes import AuctionOutcome, RunEventKind
from marketplace_node.round.decision import External
from marketplace_node.settings import ON_NEW_SCENE

AGENTS = {"/a": ("ann", "abe"), "/b": ("bob", "bea")}
hosts = st.sampled_from(sorted(AGENTS))
values = st.sampled_from([1.0, 2.5, 3.0, 5.0])


class AnyMarket(RuleBasedStateMachine):
    """Hosts, people and the network at their worst, in any order."""

    @initialize(
        mode=st.sampled_from(ON_NEW_SCENE),
        limit=st.integers(0, 2),
        strategy=st.sampled_from(["manhattan", "external", "softmax"]),
    )
    def open_market(self, mode: str, limit: int, strategy: str) -> None:
        self.mode = mode
        self.harness = MarketHarness(
            on_new_scene=mode, queue_limit=limit, preempt_cooldown_s=1.0, strategy=strategy
        )
        self.scenes = self.starts = self.seen = self.sent = 0
        self.previews: set[int] = set()
        self.asked: set[int] = set()
        self.outstanding: RunGoal | None = None
        self.open_rounds: set[int] = set()
        self.decided: list[int] = []
        self.ending: dict[tuple[str, str], CancelOpenGoals] = {}
        self.open: dict[tuple[str, str], set[OpenGoal]] = {}
        for host, agents in AGENTS.items():
            self.harness.register(host, *agents, instance="start0")

    @rule(host=hosts, fresh=st.booleans())
    def register(self, host: str, fresh: bool) -> None:
        if fresh:
            self.starts += 1
        self.harness.register(host, *AGENTS[host], instance=f"start{self.starts}")

    @rule(host=hosts, numbers=st.sets(st.integers(1, 3)))
    def open_goals(self, host: str, numbers: set[int]) -> None:
        goals = tuple(
            OpenGoal(path="", action=f"/a{number}", goal_id=bytes([number] * 16))
            for number in sorted(numbers)
        )
        instance = self.harness.instances[host]
        self.open[host, instance] = set(goals)
        self.harness.do(self.harness.market.open_goals(host, instance, goals, self.harness.now))

    @rule(confirmed=st.booleans())
    def goals_end(self, confirmed: bool) -> None:
        for key, effect in list(self.ending.items())[:1]:
            del self.ending[key]
            unconfirmed = () if confirmed else effect.goals
            self.harness.do(
                self.harness.market.goals_cancelled(*key, unconfirmed, self.harness.now)
            )

    @rule(host=hosts)
    def die(self, host: str) -> None:
        self.harness.busy.pop(host, None)

    @rule(seconds=st.sampled_from([0.0625, 0.25, 0.5, 1.25, 2.5, 6.0]))
    def wait(self, seconds: float) -> None:
        self.harness.wait(seconds)

    @rule(lasted_s=st.sampled_from([0.5, 2.5, 30.0]))
    def hold_the_market_up(self, lasted_s: float) -> None:
        self.harness.stall(lasted_s)

    @rule(host=hosts, round_number=st.sampled_from([1, 99]), own=st.booleans())
    def run_something_else(self, host: str, round_number: int, own: bool) -> None:
        self.harness.beat(host, epoch="epoch" if own else "old", round_number=round_number)

    @rule(again=st.sampled_from([0, 0, 0, 1]), urgent=st.sampled_from([False, False, True]))
    def scene(self, again: int, urgent: bool = False) -> None:
        if not (again and self.scenes):
            self.scenes += 1
        self.sent += 1
        self.harness.scene(f"s{self.scenes}", urgent=urgent)

    @rule(
        host=hosts,
        bids=st.lists(st.tuples(values, values, values), min_size=2, max_size=2),
        decline=st.booleans(),
        spoil=st.sampled_from(
            [{}, {}, {}, {}, {"epoch": "x"}, {"agent_ids": (1,) * 3}, {"round": 0}, {"round": 99}]
        ),
        challenge=st.booleans(),
    )
    def bid(
        self,
        host: str,
        bids: list[tuple[float, float, float]],
        decline: bool,
        spoil: dict[str, Any],
        challenge: bool,
    ) -> None:
        first, second = AGENTS[host]
        if challenge and self.harness.calls:
            spoil = {"round": self.harness.calls[-1].round} | spoil
        vectors = {first: bids[0]} if decline else {first: bids[0], second: bids[1]}
        declined = {second: "needs a rest"} if decline else {}
        self.harness.bid(host, vectors, declined, **spoil)

    @rule()
    def all_is_well_up_to_a_run(self) -> None:
        self.scene(again=0)
        for host, agents in AGENTS.items():
            if self.harness.status.state is State.BIDDING:
                self.harness.bid(host, dict.fromkeys(agents, (3.0, 3.0, 3.0)))
        goals = [effect.goal for effect in self.harness.all(SendGoal)]
        is_sent = bool(goals) and goals[-1] == self.harness.market.goal
        if is_sent and self.outstanding is None and self.harness.status.state is State.AWARDING:
            self.harness.accept()

    @rule(data=st.data(), what=st.sampled_from(["accept", "accept", "refuse", "end", "end"]))
    def answer_a_goal(self, data: st.DataObject, what: str) -> None:
        goals = [effect.goal for effect in self.harness.all(SendGoal)][-4:]
        if not goals:
            return
        goal = data.draw(st.sampled_from(goals[::-1]))
        alive = goal.host in self.harness.busy
        if what == "accept":
            waited_for = goal == self.outstanding
            effects = self.harness.do(self.harness.market.goal_accepted(goal, self.harness.now))
            assert waited_for or CancelGoal(goal=goal) in effects, "no tree runs unwatched"
            if alive:
                self.harness.busy[goal.host] = goal.round
        elif what == "refuse":
            self.harness.refuse(goal)
        elif alive:
            self.harness.end(data.draw(st.sampled_from([1, 2, 3, 9])), goal=goal)

    @rule(
        data=st.data(), agents=st.permutations(["ann", "abe", "bob", "bea"]), fails=st.booleans()
    )
    def rank_from_outside(self, data: st.DataObject, agents: list[str], fails: bool) -> None:
        if not self.harness.questions:
            return
        question = data.draw(st.sampled_from(self.harness.questions[-3:]))
        named = tuple(agent for agent in agents if agent in question.agents)
        external = External(failure="busy") if fails else External(ranking=named)
        self.harness.do(self.harness.market.ranked(question.round, external, self.harness.now))

    @rule(
        action=st.sampled_from(["PIN", "UNPIN", "UNPIN", "VETO", "ALLOW", "ALLOW"]),
        agent=st.sampled_from(["ann", "abe", "bob", "bea", "nobody"]),
    )
    def operate(self, action: str, agent: str) -> None:
        self.harness.operate(OperatorAction[action], agent)

    @rule(agent=st.sampled_from(["ann", "abe", "bob"]), own=st.booleans())
    def award(self, agent: str, own: bool) -> None:
        theirs = scene(f"award{self.scenes}") if own else None
        answer = self.harness.operate(OperatorAction.AWARD, agent, scene=theirs)
        if f"{agent} gets the run" in answer:
            self.sent += 1
            self.scenes += 1

    @rule(strategy=st.sampled_from(["", "external", "ucb"]))
    def preview(self, strategy: str) -> None:
        try:
            number = self.harness.preview(3.0, 3.0, 3.0, strategy=strategy)
        except Refused:
            assert len(self.previews) == MOST_PREVIEWS
            return
        self.previews |= {number} - {effect.number for effect in self.harness.previews}

    @rule()
    def collect(self) -> None:
        self.harness.collect()

    @rule(again=st.booleans(), fresh=st.booleans(), round_number=st.sampled_from([0, 0, 1, 99]))
    def cancel(self, again: bool, fresh: bool, round_number: int) -> None:
        other = scene("live", 1.0, 1.0, 1.0) if fresh else None
        self.harness.cancel("enough", again=again, scene=other, round_number=round_number)

    @invariant()
    def the_effects_keep_the_law(self) -> None:
        if not hasattr(self, "harness"):
            return
        news, self.seen = self.harness.effects[self.seen :], len(self.harness.effects)
        for effect in news:
            self.check(effect)
        ends = len(self.harness.ends)
        under_way = self.harness.status.queued + (self.harness.status.state is not State.IDLE)
        assert self.sent == ends + under_way, "every scene has one end or is still to end"

    def check(self, effect: Effect) -> None:
        match effect:
            case OpenCall() if effect.round > PREVIEWS:
                pass
            case PreviewEnded():
                self.previews.discard(effect.number)
            case RequestRanking():
                assert effect.round not in self.asked, "a question is asked once"
                self.asked.add(effect.round)
            case OpenCall():
                assert not self.open_rounds, "a round for an award or a challenge, never both"
                assert self.outstanding is None or self.mode == "preempt"
                self.open_rounds.add(effect.round)
            case PublishAuction():
                number = effect.decision.terms.round
                self.open_rounds.discard(number)
                self.decided.append(number)
                assert not effect.decision.terms.preview
                vetoed = {bid.agent for bid in effect.decision.terms.operator_exclusions}
                assert vetoed.isdisjoint(bid.agent for bid in effect.decision.ranking)
                assert self.decided == list(range(1, number + 1)), "one outcome a round"
                if effect.decision.outcome in (AuctionOutcome.PREEMPTS, AuctionOutcome.WAITS):
                    assert self.mode == "preempt"
                elif self.outstanding is not None:
                    assert self.outstanding.round == number, "no award while a tree may run"
            case SendGoal():
                assert self.outstanding is None, "never two goals outstanding"
                assert not self.ending, "nobody acts beside what the dead have left"
                self.outstanding = effect.goal
            case AnnounceRun(event=RunEventKind.REFUSED | RunEventKind.ENDED):
                if self.outstanding == effect.goal:
                    self.outstanding = None
            case AnnounceRun(event=RunEventKind.STARTED):
                assert effect.goal == self.outstanding
            case CancelOpenGoals():
                key = (effect.host, effect.instance)
                assert key not in self.ending, "a start's goals are cancelled once at a time"
                assert effect.goals
                assert set(effect.goals) <= self.open[key]
                self.ending[key] = effect
            case Collect():
                assert self.outstanding is None
            case _:
                pass

    def teardown(self) -> None:
        if not hasattr(self, "harness"):
            return
        for _ in range(20 * (self.harness.status.queued + 1)):
            self.harness.wait(1.0)
            self.the_effects_keep_the_law()
            self.goals_end(confirmed=True)
        self.the_effects_keep_the_law()
        assert self.previews == set(), "every preview is answered"
        runs = self.harness.status.state is State.RUNNING
        assert runs or self.harness.status.state is State.IDLE, "nothing waits for ever"


AnyMarket.TestCase.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
test_any_market = AnyMarket.TestCase


# A thousand scenes among hosts that die, stay silent or are slow
CROWD = {"/a": ("ann", "abe"), "/b": ("bob", "bea"), "/c": ("cat", "cem")}
SCENES = 1000
VALUES = (1.0, 2.5, 3.0, 5.0)


class Crowd:
    """Plays hosts, people and the feedback node at random, with a seed."""

    def __init__(self, mode: str, seed: int) -> None:
        self.random = random.Random(seed)
        self.harness = MarketHarness(
            on_new_scene=mode, queue_limit=4, preempt_cooldown_s=0.5, collect_deadline_s=0.25
        )
        self.seen = self.starts = 0
        self.goals: list[RunGoal] = []
        self.running: set[RunGoal] = set()
        self.down: dict[str, float] = {}
        self.sent: Counter[str] = Counter()
        for host, agents in CROWD.items():
            self.harness.register(host, *agents, instance="start0")

    def chance(self, part: float) -> bool:
        return self.random.random() < part

    def step(self) -> None:
        self.hosts_live_and_die()
        news, self.seen = self.harness.effects[self.seen :], len(self.harness.effects)
        for effect in news:
            self.answer(effect)
        self.answer_goals()
        for goal in list(self.running):
            if self.chance(0.3):
                self.finish(goal, self.random.choice((1, 1, 2)))
        if self.chance(0.04):
            self.harness.cancel("enough", again=self.chance(0.5))
        self.harness.wait(1 / 16)

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

    def hosts_live_and_die(self) -> None:
        for host, agents in CROWD.items():
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

    def answer(self, effect: Effect) -> None:
        match effect:
            case OpenCall():
                for host in CROWD:
                    if host not in self.down and self.chance(0.95):  # else it is silent
                        self.bid(host, effect.round)
            case SendGoal():
                self.goals.append(effect.goal)
            case CancelGoal() if effect.goal in self.running and self.chance(0.9):
                self.finish(effect.goal, 3)
            case Collect() if self.chance(0.5):
                number = effect.goal.round
                self.harness.do(self.harness.market.collected(number, "learned", self.harness.now))
            case _:
                pass

    def bid(self, host: str, number: int) -> None:
        if self.chance(0.1):
            self.harness.bid(host, {}, dict.fromkeys(CROWD[host], "is tired"), round=number)
        else:
            vectors = {name: tuple(self.random.choices(VALUES, k=3)) for name in CROWD[host]}
            self.harness.bid(host, vectors, round=number)

    def answer_goals(self) -> None:
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
    codes = {code for _, code in crowd.harness.ends}
    expected = {"SUCCEEDED", "FAILED", "CANCELLED", "LOST", "NOT_FINITE", "STOPPED"}
    expected |= {"reject": {"BUSY"}, "queue": {"QUEUE_FULL"}, "preempt": {"PREEMPTED"}}[mode]
    assert expected <= codes
