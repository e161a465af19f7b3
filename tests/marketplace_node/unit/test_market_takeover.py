# SPDX-License-Identifier: Apache-2.0
"""What a host still does without an award: no other agent acts before that ends."""

from __future__ import annotations

import pytest

from bt_agents_core.open_goals import OpenGoal
from market_harness import EXPRESS, GUIDE, MarketHarness
from marketplace_node.effects import Alarm, AnnounceRun, SendGoal, State
from marketplace_node.hosts.goal_takeover import MOST_STARTS, GoalTakeover, StoredGoals
from marketplace_node.hosts.host_effects import CancelAll, CancelGoal, CancelOpenGoals
from marketplace_node.interaction.stored_scenes import StoreScenes, format_scenes

A, B = "/a", "/b"
DRIVE = OpenGoal(path="tree/1.drive", action="/drive", goal_id=b"1" * 16)
SAY = OpenGoal(path="tree/2.say", action="/say", goal_id=b"2" * 16)
WAITS = f"{EXPRESS} gets the run, but goals of {A} are being cancelled: /drive (tree/1.drive)"


def two_hosts(**settings: float) -> MarketHarness:
    """Return a market with the guide at one host, and the express at another."""
    market = MarketHarness(**settings)
    market.register(A, GUIDE)
    market.register(B, EXPRESS)
    return market


def award_to_a(market: MarketHarness) -> None:
    market.scene("s1")
    bid_of_a(market)
    bid_of_b(market)


@pytest.fixture
def two() -> MarketHarness:
    """Return a market of two hosts, which waits for neither."""
    return two_hosts(host_wait_s=0)


@pytest.fixture
def driving() -> MarketHarness:
    """Return a market of two hosts in which the guide drives."""
    market = two_hosts()
    award_to_a(market)
    market.accept()
    opens(market, A, DRIVE)
    return market


def bid_of_a(market: MarketHarness) -> None:
    market.bid(A, {GUIDE: (4.0, 1.5, 3.0)})


def bid_of_b(market: MarketHarness) -> None:
    market.bid(B, {EXPRESS: (3.0, 5.0, 3.5)})


def opens(market: MarketHarness, host: str, *goals: OpenGoal, instance: str = "first") -> None:
    market.do(market.market.open_goals(host, instance, goals, market.now))


def goals_end(market: MarketHarness, *unconfirmed: OpenGoal) -> None:
    market.do(market.market.goals_cancelled(A, "first", unconfirmed, market.now))


def starts(market: MarketHarness) -> list[str]:
    return [effect.goal.agent for effect in market.all(SendGoal)]


def test_next_run_waits_for_goals_of_dead_host(driving: MarketHarness):
    driving.lose(A, away_s=0.9)
    assert driving.all(CancelOpenGoals) == [
        CancelOpenGoals(host=A, instance="first", goals=(DRIVE,), within_s=3.0)
    ]
    [end] = [run for run in driving.all(AnnounceRun) if run.outcome]
    assert (end.outcome.name, end.orphans) == ("LOST", ("tree/1.drive",))
    bid_of_b(driving)
    assert (driving.status.state, driving.status.message) == (State.AWARDING, WAITS)
    assert starts(driving) == [GUIDE]
    goals_end(driving)
    assert starts(driving) == [GUIDE, EXPRESS]
    driving.accept()
    assert driving.status.message == f"{EXPRESS} is running"


def test_run_reports_unconfirmed_goals_of_dead_host(driving: MarketHarness):
    opens(driving, A, DRIVE, SAY)
    driving.lose(A, away_s=0.9)
    bid_of_b(driving)
    goals_end(driving, DRIVE)
    driving.accept()
    beside = f"not confirmed to have ended: /drive (tree/1.drive) of {A}"
    assert driving.status.message == f"{EXPRESS} is running; {beside}"
    assert driving.all(AnnounceRun)[-1].message == f"the host took the run; {beside}"
    assert driving.all(Alarm)[-1].message == (
        f"goals of {A} may go on, as their servers have not confirmed their end: "
        "/drive (tree/1.drive)"
    )
    driving.finish()
    driving.scene("s2")
    bid_of_b(driving)
    driving.accept()
    assert driving.status.message == f"{EXPRESS} is running", "said once"


def test_dead_host_without_open_goals_is_not_awaited(driving: MarketHarness):
    opens(driving, A)
    driving.lose(A, away_s=0.9)
    bid_of_b(driving)
    assert driving.all(CancelOpenGoals) == []
    assert starts(driving) == [GUIDE, EXPRESS]


def test_restarted_host_also_waits_for_its_open_goals(driving: MarketHarness):
    driving.lose(A, away_s=0.9)
    driving.register(A, GUIDE, instance="second")
    assert [one.instance for one in driving.all(CancelOpenGoals)] == ["first"]
    bid_of_b(driving)
    driving.cancel(round_number=0)
    driving.scene("s2")
    bid_of_a(driving)
    bid_of_b(driving)
    assert starts(driving) == [GUIDE]
    goals_end(driving)
    assert starts(driving) == [GUIDE, GUIDE]


def test_market_cancels_orphans_of_host_dying_after_run(driving: MarketHarness):
    driving.finish()
    driving.lose(A, away_s=0.9)
    assert [one.goals for one in driving.all(CancelOpenGoals)] == [(DRIVE,)]
    driving.scene("s2")
    bid_of_b(driving)
    assert driving.status.message == WAITS


def test_run_ignoring_stop_has_its_goals_cancelled(driving: MarketHarness):
    driving.cancel(again=True)
    driving.wait(14.1)
    assert driving.events[-1] == "1 attentive_guide ENDED LOST"
    assert "did not end within 14 s" in driving.all(AnnounceRun)[-1].message
    assert [one.goals for one in driving.all(CancelOpenGoals)] == [(DRIVE,)]


def test_goals_opened_during_cancellation_are_cancelled_next(driving: MarketHarness):
    driving.lose(A, away_s=0.9)
    bid_of_b(driving)
    # It comes from a host that hung, and is read late.
    opens(driving, A, SAY)
    driving.beat(A)
    driving.wait(0.9)
    goals_end(driving)
    assert [one.goals for one in driving.all(CancelOpenGoals)] == [(DRIVE,), (SAY,)]
    assert starts(driving) == [GUIDE]
    goals_end(driving)
    assert starts(driving) == [GUIDE, EXPRESS]


def test_unregistered_starts_are_bounded_and_evict_no_host():
    takeover = GoalTakeover()
    takeover.store(A, "first", (DRIVE,))
    assert takeover.lost(lambda host, _instance: host == A, 1.0, 0.0) == []
    for number in range(3 * MOST_STARTS):
        takeover.store(f"/h{number}", "first", (SAY,))
    assert len(takeover._open) == MOST_STARTS
    [lost] = takeover.lost(lambda _host, _instance: False, 1.0, 0.0)
    assert (lost.host, lost.goals) == (A, (DRIVE,))


def test_stalled_market_takes_nothing_over_from_live_host(driving: MarketHarness):
    since, driving.now = driving.now, driving.now + 5.0
    driving.beat(B, round_number=0)
    driving.do(driving.market.extend_after_stall(since, driving.now))
    driving.beat(A, round_number=1)
    driving.wait(1.0)
    assert (driving.all(CancelOpenGoals), driving.status.message) == ([], f"{GUIDE} is running")


def next_market(market: MarketHarness) -> MarketHarness:
    """Return the next start of a killed market, which has read the stored state."""
    after = MarketHarness()
    text = format_scenes(market.all(StoreScenes)[-1])
    after.do(after.market.restore_scenes(text, 1.0, after.now)[1])
    return after


def test_next_market_cancels_open_goals_of_dead_host(driving: MarketHarness):
    driving.finish()
    after = next_market(driving)
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


def test_surviving_host_keeps_its_goals_after_market_restart(driving: MarketHarness):
    after = next_market(driving)
    after.stall(5.0)
    after.register(A, GUIDE)
    after.wait(10.0)
    assert after.all(CancelOpenGoals) == [], "a stalled market waits longer for it"
    after.lose(A, away_s=0.9)
    assert [one.goals for one in after.all(CancelOpenGoals)] == [(DRIVE,)]


def test_next_market_finishes_goal_cancellation(driving: MarketHarness):
    driving.lose(A, away_s=0.9)
    assert driving.all(StoreScenes)[-1].open_goals == (
        StoredGoals(host=A, instance="first", goals=(DRIVE,)),
    )
    after = next_market(driving)
    after.wait(1.6)
    assert [one.goals for one in after.all(CancelOpenGoals)] == [(DRIVE,)]


# Trees that run without an award


def award_to_b_while_a_runs_for_another_market(market: MarketHarness) -> None:
    market.beat(A, epoch="old", round_number=7)
    market.scene("s1")
    bid_of_b(market)


def run_for_another_market(market: MarketHarness, tenths: int) -> None:
    """Let A run for another market for some tenths of a second."""
    for _ in range(tenths):
        market.beat(A, epoch="old", round_number=7)
        market.wait(0.1)


def test_tree_running_despite_refused_goal_is_cancelled(two: MarketHarness) -> None:
    award_to_a(two)
    first = two.goal
    two.refuse(first)
    two.refuse()
    assert two.ends == [("s1", "NOT_TAKEN")]
    two.busy[A] = first.round
    two.wait(0.5)

    assert two.all(CancelAll) == [CancelAll(host=A)]
    two.wait(1.0)
    assert two.all(CancelAll) == [CancelAll(host=A)] * 2, "again each second, until it has ended"
    two.scene("s2")
    bid_of_b(two)
    reason = "it runs a tree of round 1 that nobody waits for"
    assert two.auction.decision.terms.unasked == {A: reason}
    assert two.status.message == f"{EXPRESS} gets the run, but {A} has not stopped: {reason}"
    two.busy[A] = 0
    two.wait(0.1)
    assert two.goal.host == B


def test_heartbeat_predating_run_end_stops_nothing(two: MarketHarness) -> None:
    award_to_a(two)
    two.perform()
    two.beat(A, round_number=1)
    two.scene("s2")
    assert two.calls[-1].hosts == 2
    two.wait(0.1)

    assert (two.all(CancelAll), two.status.state) == ([], State.BIDDING)


def test_goal_waits_for_tree_of_earlier_market(two: MarketHarness) -> None:
    award_to_b_while_a_runs_for_another_market(two)

    reason = "it still runs a tree for another market"
    assert (two.auction.decision.terms.unasked, two.all(SendGoal)) == ({A: reason}, [])
    assert two.status.state is State.AWARDING
    assert two.status.message == f"{EXPRESS} gets the run, but {A} has not stopped: {reason}"
    two.beat(A, round_number=0)
    assert (two.goal.host, two.status.message) == (B, f"{EXPRESS} gets the run")
    two.accept()
    assert two.status.state is State.RUNNING


def test_endless_tree_is_awaited_for_limited_time(two: MarketHarness) -> None:
    two.busy.pop(A)
    award_to_b_while_a_runs_for_another_market(two)
    run_for_another_market(two, 110)
    assert two.all(SendGoal) == []
    run_for_another_market(two, 30)

    assert two.goal.host == B


def test_silent_host_is_not_awaited(two: MarketHarness) -> None:
    award_to_b_while_a_runs_for_another_market(two)
    two.lose(A, away_s=0.9)

    assert two.goal.host == B


def test_abandoned_run_is_awaited_while_host_lives(two: MarketHarness) -> None:
    award_to_a(two)
    two.accept()
    two.scene("s2")
    two.cancel(round_number=1)
    two.wait(14.1)
    assert two.events[-1] == "1 attentive_guide ENDED LOST"
    bid_of_b(two)

    assert [send.goal.host for send in two.all(SendGoal)] == [A]
    assert f"{A} has not stopped: its run of round 1 has not ended" in two.status.message
    two.busy[A] = 0
    two.wait(0.1)
    assert two.goal.host == B


def test_held_goal_can_be_stopped(two: MarketHarness) -> None:
    award_to_b_while_a_runs_for_another_market(two)

    assert two.cancel("enough") == (True, f"{EXPRESS} does not begin")
    assert (two.ends, two.all(CancelGoal)) == ([("s1", "STOPPED")], [])
    two.beat(A, round_number=0)
    assert two.all(SendGoal) == []


def test_dead_host_never_receives_its_held_goal(two: MarketHarness) -> None:
    two.busy.pop(A)
    award_to_b_while_a_runs_for_another_market(two)
    two.die(B)
    run_for_another_market(two, 10)

    assert (two.all(SendGoal), two.ends, two.all(CancelGoal)) == ([], [("s1", "NOT_TAKEN")], [])
