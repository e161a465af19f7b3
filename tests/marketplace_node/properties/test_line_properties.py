# SPDX-License-Identifier: Apache-2.0
"""Laws of the line: each scene and run ends once, and none for lack of a host."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from bt_agents_core.stop_cause import StopCause
from market_harness import EXPRESS, GUIDE, SPACE, MarketHarness, scene
from marketplace_node.effects import (
    AnnounceEarlierRun,
    AnnounceRun,
    EarlierRun,
    PublishAuction,
    SendGoal,
    State,
)
from marketplace_node.hosts.host_effects import RunGoal
from marketplace_node.interaction.scene_admission import ROUNDS_IN_VAIN
from marketplace_node.interaction.stored_scenes import StoreScenes, format_scenes
from marketplace_node.market import Market
from marketplace_node.outcomes import RunEventKind, RunOutcome
from marketplace_node.settings import Settings

HOST = "/agents"
SETTINGS = Settings(
    strategy="manhattan", queue_limit=100, collect_deadline_s=0.1, preempt_cooldown_s=0.5
)
outages = st.sampled_from([0.125, 0.5, 0.75, 1.5, 4.5])


class AnyLine(RuleBasedStateMachine):
    """One host and one market that are killed, stopped and restarted in any order."""

    @initialize(mode=st.sampled_from(["queue", "preempt"]))
    def start(self, mode: str) -> None:
        self.settings = replace(SETTINGS, on_new_scene=mode)
        self.markets = self.starts = self.scenes = self.seen = 0
        self.stored = ""
        self.ends: Counter[str] = Counter()
        self.codes: dict[str, str] = {}
        self.rounds: Counter[str] = Counter()
        self.started: set[tuple[str, int]] = set()
        self.ended: dict[tuple[str, int], RunOutcome] = {}
        self.running: tuple[str, RunGoal, str] | None = None
        self.unreported: list[EarlierRun] = []
        self.harness = MarketHarness()
        self.start_market(0.0)
        self.register(fresh=True)

    def start_market(self, away_s: float) -> None:
        """Start a market of the next epoch, with everything that the last one stored."""
        now = self.harness.now + away_s
        self.markets += 1
        self.harness = MarketHarness()
        self.harness.now, self.seen = now, 0
        self.harness.market = Market(SPACE, self.epoch, self.settings, secret=b"")
        self.harness.do(self.harness.market.tick(now))
        if self.stored:
            self.harness.do(self.harness.market.restore_scenes(self.stored, away_s, now)[1])
        self.take_effects()

    @property
    def epoch(self) -> str:
        return f"epoch{self.markets}"

    def register(self, *, fresh: bool) -> None:
        if fresh:
            self.starts += 1
            self.running, self.unreported = None, []
        self.harness.register(HOST, GUIDE, EXPRESS, instance=f"start{self.starts}")
        reported = [run for run in self.unreported if run.epoch != self.epoch]
        self.harness.do(self.harness.market.unreported(HOST, reported, self.harness.now))
        self.unreported = [run for run in self.unreported if run not in reported]

    @rule(count=st.integers(1, 4), urgent=st.booleans())
    def announce(self, count: int, urgent: bool) -> None:
        for _ in range(count):
            self.scenes += 1
            self.harness.scene(f"s{self.scenes}", urgent=urgent)

    @rule(steps=st.integers(1, 6))
    def go_on(self, steps: int) -> None:
        """Let host and market work for some heartbeats."""
        for _ in range(steps):
            self.answer()
            self.harness.wait(0.0625)
            self.take_effects()

    def answer(self) -> None:
        market = self.harness
        if HOST not in market.busy:
            return
        for call in market.calls[-2:]:
            market.bid(round=call.round, epoch=self.epoch)
        sent = market.all(SendGoal)
        if not sent or sent[-1].goal.instance != f"start{self.starts}":
            return
        goal = sent[-1].goal
        if market.market.goal == goal and market.market.state is State.AWARDING:
            market.accept(goal)
            self.running = (self.epoch, goal, sent[-1].scene.scene_id)
        elif market.market.goal == goal and self.running is not None:
            stopped = market.market.state is State.CANCELLING
            market.end(3 if stopped else 1, goal=goal)
            self.running = None
        elif self.running is not None and market.market.goal != goal:
            self.running, market.busy[HOST] = None, 0

    @rule(away_s=outages, killed=st.booleans(), early=st.booleans())
    def lose_the_host(self, away_s: float, killed: bool, early: bool) -> None:
        """Kill or suspend the host, and bring it back in time."""
        if not early:
            self.answer()
        self.harness.busy.pop(HOST, None)
        self.harness.wait(away_s)
        self.take_effects()
        if killed:
            self.harness.wait(max(0.0, 1.0 - away_s))
            self.register(fresh=True)
        else:
            running = self.running is not None and self.running[0] == self.epoch
            assert self.running is None or running
            self.harness.busy[HOST] = self.running[1].round if self.running else 0
            self.go_on(steps=1)  # a host that goes on answers what it missed

    @rule(away_s=outages, with_host=st.booleans(), ended=st.booleans())
    def lose_the_market(self, away_s: float, with_host: bool, ended: bool) -> None:
        """Kill the market, alone or with the host, and restart it."""
        self.take_effects()
        if self.running is not None:
            epoch, goal, scene_id = self.running
            how = (RunOutcome.SUCCEEDED, 0) if ended else (RunOutcome.CANCELLED, None)
            self.unreported.append(
                EarlierRun(
                    outcome=how[0],
                    goal=goal,
                    scene=scene(scene_id),
                    message="its market is gone",
                    stop_cause=StopCause.NOT_STOPPED if ended else StopCause.MARKET_LOST,
                    epoch=epoch,
                    age_s=away_s,
                )
            )
            self.running = None
        self.start_market(away_s)
        self.register(fresh=with_host)

    @invariant()
    def each_scene_ends_once(self) -> None:
        if hasattr(self, "harness"):
            self.take_effects()

    def take_effects(self) -> None:
        news, self.seen = self.harness.effects[self.seen :], len(self.harness.effects)
        for effect in news:
            if isinstance(effect, StoreScenes):
                self.stored = format_scenes(effect)
            elif isinstance(effect, PublishAuction):
                self.rounds[effect.decision.terms.scene.scene_id] += 1
            elif isinstance(effect, AnnounceRun):
                self.take_run(effect)
            elif isinstance(effect, AnnounceEarlierRun):
                # Both markets may announce an end that the first one stored.
                run, key = effect.run, (effect.run.epoch, effect.run.goal.round)
                assert self.ended.setdefault(key, run.outcome) is run.outcome, run
        for effect in news:
            scene_id = getattr(effect, "code", None) and effect.scene_id
            if not scene_id or (effect.epoch and scene_id in self.ends):
                assert not scene_id or self.codes[scene_id] == effect.code
                continue
            self.ends[scene_id] += 1
            self.codes[scene_id] = effect.code
            assert self.ends[scene_id] == 1, f"{scene_id} has a second end: {effect}"
            if effect.code in ("NO_BIDS", "NOT_TAKEN"):
                assert self.rounds[scene_id] >= ROUNDS_IN_VAIN, effect

    def take_run(self, effect: AnnounceRun) -> None:
        key = (self.epoch, effect.goal.round)
        if effect.event is RunEventKind.STARTED:
            self.started.add(key)
        elif effect.event is RunEventKind.ENDED:
            assert key not in self.ended, f"{key} has a second end: {effect}"
            self.ended[key] = effect.outcome
            if self.running is not None and self.running[1] == effect.goal:
                self.running = None

    def teardown(self) -> None:
        if not hasattr(self, "harness"):
            return
        quiet = 0
        for _ in range(400):
            if quiet == 8:
                break
            self.go_on(steps=8)
            idle = self.harness.status.state is State.IDLE and not self.harness.status.queued
            quiet = quiet + 1 if idle else 0
            if idle:  # it may still wait for a report, or for another request
                self.harness.wait(1.0)
        missing = {f"s{number}" for number in range(1, self.scenes + 1)} - set(self.ends)
        assert not missing, f"without an end: {missing}, {self.harness.status}"
        assert self.started <= self.ended.keys(), "runs without an end"


AnyLine.TestCase.settings = settings(max_examples=60, stateful_step_count=25, deadline=None)
test_any_line = AnyLine.TestCase
