# SPDX-License-Identifier: Apache-2.0
"""Orphans: they are stopped before another host begins."""

from __future__ import annotations

import pytest

from market_harness import EXPRESS, GUIDE, MarketHarness
from marketplace_node.effects import SendGoal, State
from marketplace_node.hosts.host_effects import CancelAll, CancelGoal

A, B = "/a", "/b"


@pytest.fixture
def two() -> MarketHarness:
    """Return a market with a guide at one host and an express at another; it waits for no host."""
    harness = MarketHarness(host_wait_s=0)
    harness.register(A, GUIDE)
    harness.register(B, EXPRESS)
    return harness


def bid(market: MarketHarness, host: str) -> None:
    market.bid(host, {GUIDE: (4.0, 1.5, 3.0)} if host == A else {EXPRESS: (3.0, 5.0, 3.5)})


def award_to_b_while_a_runs_for_another_market(market: MarketHarness) -> None:
    market.beat(A, epoch="old", round_number=7)
    market.scene("s1")
    bid(market, B)


def test_tree_running_despite_refused_goal_is_cancelled(two: MarketHarness) -> None:
    two.scene("s1")
    bid(two, A)
    bid(two, B)
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
    bid(two, B)
    reason = "it runs a tree of round 1 that nobody waits for"
    assert two.auction.decision.terms.unasked == {A: reason}
    assert two.status.message == f"{EXPRESS} gets the run, but {A} has not stopped: {reason}"
    two.busy[A] = 0
    two.wait(0.1)
    assert two.goal.host == B


def test_heartbeat_predating_run_end_stops_nothing(two: MarketHarness) -> None:
    two.scene("s1")
    bid(two, A)
    bid(two, B)
    two.perform()
    two.beat(A, round_number=1)
    two.scene("s2")
    assert two.calls[-1].hosts == 2
    two.wait(0.1)

    assert two.all(CancelAll) == []
    assert two.status.state is State.BIDDING


def test_goal_waits_for_tree_of_earlier_market(two: MarketHarness) -> None:
    award_to_b_while_a_runs_for_another_market(two)

    assert two.all(SendGoal) == []
    assert two.status.state is State.AWARDING
    assert two.status.message == (
        f"{EXPRESS} gets the run, but {A} has not stopped: it still runs a tree for another market"
    )
    two.beat(A, round_number=0)
    assert two.goal.host == B
    assert two.status.message == f"{EXPRESS} gets the run"
    two.accept()
    assert two.status.state is State.RUNNING


def test_endless_tree_is_awaited_for_limited_time(two: MarketHarness) -> None:
    two.busy.pop(A)
    award_to_b_while_a_runs_for_another_market(two)
    for _ in range(110):
        two.beat(A, epoch="old", round_number=7)
        two.wait(0.1)
    assert two.all(SendGoal) == []
    for _ in range(30):
        two.beat(A, epoch="old", round_number=7)
        two.wait(0.1)

    assert two.goal.host == B


def test_silent_host_is_not_awaited(two: MarketHarness) -> None:
    award_to_b_while_a_runs_for_another_market(two)
    two.lose(A, away_s=0.9)

    assert two.goal.host == B


def test_abandoned_run_is_awaited_while_host_lives(two: MarketHarness) -> None:
    two.scene("s1")
    bid(two, A)
    bid(two, B)
    two.accept()
    two.scene("s2")
    two.cancel(round_number=1)
    two.wait(14.1)
    assert two.events[-1] == "1 attentive_guide ENDED LOST"
    bid(two, B)

    assert [send.goal.host for send in two.all(SendGoal)] == [A]
    assert f"{A} has not stopped: its run of round 1 has not ended" in two.status.message
    two.busy[A] = 0
    two.wait(0.1)
    assert two.goal.host == B


def test_held_goal_can_be_stopped(two: MarketHarness) -> None:
    award_to_b_while_a_runs_for_another_market(two)

    assert two.cancel("enough") == (True, f"{EXPRESS} does not begin")
    assert two.ends == [("s1", "STOPPED")]
    assert two.all(CancelGoal) == []
    two.beat(A, round_number=0)
    assert two.all(SendGoal) == []


def test_dead_host_never_receives_its_held_goal(two: MarketHarness) -> None:
    two.busy.pop(A)
    award_to_b_while_a_runs_for_another_market(two)
    two.die(B)
    for _ in range(10):
        two.beat(A, epoch="old", round_number=7)
        two.wait(0.1)

    assert two.all(SendGoal) == []
    assert two.ends == [("s1", "NOT_TAKEN")]
    assert two.all(CancelGoal) == []
