# SPDX-License-Identifier: Apache-2.0
"""Takeover of goals that a dead host has left open: no agent acts before they end."""

from __future__ import annotations

import pytest

from bt_agents_core.open_goals import OpenGoal
from market_harness import EXPRESS, GUIDE, MarketHarness
from marketplace_node.effects import Alarm, AnnounceRun, SendGoal, State
from marketplace_node.hosts.goal_takeover import MOST_STARTS, GoalTakeover, StoredGoals
from marketplace_node.hosts.host_effects import CancelOpenGoals
from marketplace_node.interaction.stored_scenes import StoreScenes, format_scenes

A, B = "/a", "/b"
DRIVE = OpenGoal(path="tree/1.drive", action="/drive", goal_id=b"1" * 16)
SAY = OpenGoal(path="tree/2.say", action="/say", goal_id=b"2" * 16)
WAITS = f"{EXPRESS} gets the run, but goals of {A} are being cancelled: /drive (tree/1.drive)"


@pytest.fixture
def two() -> MarketHarness:
    """Return a market with a driving guide at one host, and an express at another."""
    harness = MarketHarness()
    harness.register(A, GUIDE)
    harness.register(B, EXPRESS)
    harness.scene("s1")
    bid_of_a(harness)
    bid_of_b(harness)
    harness.accept()
    opens(harness, A, DRIVE)
    return harness


def bid_of_a(market: MarketHarness) -> None:
    market.bid(A, {GUIDE: (4.0, 1.5, 3.0)})


def bid_of_b(market: MarketHarness) -> None:
    market.bid(B, {EXPRESS: (3.0, 5.0, 3.5)})


def opens(market: MarketHarness, host: str, *goals: OpenGoal, instance: str = "first") -> None:
    market.do(market.market.open_goals(host, instance, goals, market.now))


def goals_end(market: MarketHarness, *unconfirmed: OpenGoal, host: str = A) -> None:
    market.do(market.market.goals_cancelled(host, "first", unconfirmed, market.now))


def starts(market: MarketHarness) -> list[str]:
    return [effect.goal.agent for effect in market.all(SendGoal)]


def test_next_run_waits_for_goals_of_dead_host(two: MarketHarness):
    two.lose(A, away_s=0.9)
    assert two.all(CancelOpenGoals) == [
        CancelOpenGoals(host=A, instance="first", goals=(DRIVE,), within_s=3.0)
    ]
    bid_of_b(two)
    assert (two.status.state, two.status.message) == (State.AWARDING, WAITS)
    assert starts(two) == [GUIDE]
    goals_end(two)
    assert starts(two) == [GUIDE, EXPRESS]
    two.accept()
    assert two.status.message == f"{EXPRESS} is running"


def test_lost_run_names_nodes_with_possibly_active_goals(two: MarketHarness):
    two.lose(A, away_s=0.9)
    [end] = [run for run in two.all(AnnounceRun) if run.outcome]
    assert (end.outcome.name, end.orphans) == ("LOST", ("tree/1.drive",))


def test_run_reports_unconfirmed_goals_of_dead_host(two: MarketHarness):
    opens(two, A, DRIVE, SAY)
    two.lose(A, away_s=0.9)
    bid_of_b(two)
    goals_end(two, DRIVE)
    two.accept()
    beside = f"not confirmed to have ended: /drive (tree/1.drive) of {A}"
    assert two.status.message == f"{EXPRESS} is running; {beside}"
    assert two.all(AnnounceRun)[-1].message == f"the host took the run; {beside}"
    assert two.all(Alarm)[-1].message == (
        f"goals of {A} may go on, as their servers have not confirmed their end: "
        "/drive (tree/1.drive)"
    )
    two.finish()
    two.scene("s2")
    bid_of_b(two)
    two.accept()
    assert two.status.message == f"{EXPRESS} is running", "said once"


def test_dead_host_without_open_goals_is_not_awaited(two: MarketHarness):
    opens(two, A)
    two.lose(A, away_s=0.9)
    bid_of_b(two)
    assert two.all(CancelOpenGoals) == []
    assert starts(two) == [GUIDE, EXPRESS]


def test_restarted_host_also_waits_for_its_open_goals(two: MarketHarness):
    two.lose(A, away_s=0.9)
    two.register(A, GUIDE, instance="second")
    goals = two.all(CancelOpenGoals)
    assert [one.instance for one in goals] == ["first"]
    bid_of_b(two)
    two.cancel(round_number=0)
    two.scene("s2")
    bid_of_a(two)
    bid_of_b(two)
    assert starts(two) == [GUIDE]
    goals_end(two)
    assert starts(two) == [GUIDE, GUIDE]


def test_market_cancels_orphans_of_host_dying_after_run(two: MarketHarness):
    two.finish()
    two.lose(A, away_s=0.9)
    assert [one.goals for one in two.all(CancelOpenGoals)] == [(DRIVE,)]
    two.scene("s2")
    bid_of_b(two)
    assert two.status.message == WAITS


def test_run_ignoring_stop_has_its_goals_cancelled(two: MarketHarness):
    two.cancel(again=True)
    two.wait(14.1)
    assert two.events[-1].endswith("ENDED LOST") or "LOST" in " ".join(two.events)
    assert [one.goals for one in two.all(CancelOpenGoals)] == [(DRIVE,)]


def test_goals_opened_during_cancellation_are_cancelled_next(two: MarketHarness):
    two.lose(A, away_s=0.9)
    bid_of_b(two)
    # It comes from a host that hung, and is read late.
    opens(two, A, SAY)
    two.beat(A)
    two.wait(0.9)
    goals_end(two)
    assert [one.goals for one in two.all(CancelOpenGoals)] == [(DRIVE,), (SAY,)]
    assert starts(two) == [GUIDE]
    goals_end(two)
    assert starts(two) == [GUIDE, EXPRESS]


def test_goals_of_unregistered_start_are_not_cancelled(two: MarketHarness):
    opens(two, "/stranger", SAY)
    opens(two, A, SAY, instance="another")
    two.wait(30.0)
    assert two.all(CancelOpenGoals) == []


def test_unregistered_starts_are_bounded_and_evict_no_host():
    takeover = GoalTakeover()
    takeover.store(A, "first", (DRIVE,))
    assert takeover.lost(lambda host, _instance: host == A, 1.0, 0.0) == []
    for number in range(3 * MOST_STARTS):
        takeover.store(f"/h{number}", "first", (SAY,))
    assert len(takeover._open) == MOST_STARTS
    [lost] = takeover.lost(lambda _host, _instance: False, 1.0, 0.0)
    assert (lost.host, lost.goals) == (A, (DRIVE,))


def test_stalled_market_takes_nothing_over_from_live_host(two: MarketHarness):
    since, two.now = two.now, two.now + 5.0
    two.beat(B, round_number=0)
    two.do(two.market.extend_after_stall(since, two.now))
    two.beat(A, round_number=1)
    two.wait(1.0)
    assert two.all(CancelOpenGoals) == []
    assert two.status.message == f"{GUIDE} is running"


def next_market(market: MarketHarness) -> MarketHarness:
    """Return the next start of a killed market, which has read the stored state."""
    after = MarketHarness()
    text = format_scenes(market.all(StoreScenes)[-1])
    after.do(after.market.restore_scenes(text, 1.0, after.now)[1])
    return after


def test_next_market_cancels_open_goals_of_dead_host(two: MarketHarness):
    two.finish()
    after = next_market(two)
    after.register(B, EXPRESS)
    after.scene("s2")
    bid_of_b(after)
    assert starts(after) == []
    assert f"{A} may have open goals of an earlier run: /drive (tree/1.drive)" in (
        after.status.message
    )
    after.wait(1.6)
    assert [(one.host, one.goals) for one in after.all(CancelOpenGoals)] == [(A, (DRIVE,))]
    assert starts(after) == []
    goals_end(after)
    assert starts(after) == [EXPRESS]


def test_surviving_host_keeps_its_goals_after_market_restart(two: MarketHarness):
    after = next_market(two)
    after.register(A, GUIDE)
    after.wait(10.0)
    assert after.all(CancelOpenGoals) == []
    after.lose(A, away_s=0.9)
    assert [one.goals for one in after.all(CancelOpenGoals)] == [(DRIVE,)]


def test_next_market_does_not_await_host_without_goals(two: MarketHarness):
    opens(two, A)
    two.finish()
    after = next_market(two)
    after.register(B, EXPRESS)
    after.scene("s2")
    bid_of_b(after)
    assert starts(after) == [EXPRESS]


def test_next_market_finishes_goal_cancellation(two: MarketHarness):
    two.lose(A, away_s=0.9)
    assert two.all(StoreScenes)[-1].open_goals == (
        StoredGoals(host=A, instance="first", goals=(DRIVE,)),
    )
    after = next_market(two)
    after.wait(1.6)
    assert [one.goals for one in after.all(CancelOpenGoals)] == [(DRIVE,)]


def test_stalled_market_waits_longer_for_earlier_hosts(two: MarketHarness):
    after = next_market(two)
    after.stall(5.0)
    after.register(A, GUIDE)
    after.wait(1.0)
    assert after.all(CancelOpenGoals) == []
