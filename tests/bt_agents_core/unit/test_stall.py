# SPDX-License-Identifier: Apache-2.0
"""Stalls of a host, and its lease on the market of its run, in tables on a manual clock."""

from __future__ import annotations

from typing import Any

import pytest

from bt_agents.host.run_monitors import AwardMonitor, MarketLease
from bt_agents_core.liveness import StallDetector
from bt_agents_core.run_key import RunKey


@pytest.mark.parametrize(
    ("looks", "wait_s", "lasted_s"),
    [
        ([], 0.0, 0.0),
        ([0.1, 0.2, 0.3], 0.0, 0.0),
        ([0.1, 0.6], 0.0, 0.0),
        ([0.1, 2.4], 0.3, 2.3),
        ([0.1, 2.4, 2.5], 0.2, 2.3),
        ([0.1, 2.4, 2.7], 0.0, 2.3),
        ([0.1, 2.4, 2.9], 0.0, 2.3),
        ([0.1, 2.4, 2.5, 4.0], 0.3, 1.5),
    ],
)
def test_stall_holds_off_until_messages_are_read(
    looks: list[float], wait_s: float, lasted_s: float
) -> None:
    held_up = StallDetector(0.0, limit_s=0.55, settle_s=0.3)
    found = 0.0
    for now in looks:
        found = held_up.poll(now)
    assert found == pytest.approx(wait_s)
    assert held_up.last_stall_s == pytest.approx(lasted_s)
    assert held_up.confirmed == (lasted_s == 0.0)


MINE = RunKey(epoch="e1", round=3, agent="guide")
NOBODYS = RunKey(epoch="e1")
NEXT_BEST = RunKey(epoch="e1", round=3, agent="talker")
LATER = RunKey(epoch="e1", round=4, agent="guide")
STRANGE = RunKey(epoch="e2", round=9, agent="guide")


def after_a_hold_up(*heard_before: RunKey) -> AwardMonitor:
    """Return the state of a process that stalled from 0 to 2 s and has recovered at 2.3 s."""
    word = AwardMonitor(0.0)
    for award in heard_before:
        assert not word.on_heartbeat(award, MINE, 0.0)
    word.stall.poll(2.0)
    return word


@pytest.mark.parametrize(
    ("heard", "given_away", "goes_on"),
    [
        ([], False, False),
        ([MINE], False, True),
        ([NOBODYS], False, False),
        ([NOBODYS, NOBODYS], True, False),
        ([NEXT_BEST, NEXT_BEST], True, False),
        ([NOBODYS, MINE], False, True),
        ([LATER, LATER], True, False),
        ([STRANGE, STRANGE], False, False),
        ([STRANGE, MINE], False, True),
    ],
)
def test_run_survives_stall_only_if_market_confirms_it(
    heard: list[RunKey], given_away: bool, goes_on: bool
) -> None:
    word = after_a_hold_up(MINE)
    assert [word.on_heartbeat(award, MINE, 2.5) for award in heard][-1:] in ([], [given_away])
    assert (word.hold_off_s(MINE, 2.5) == 0.0) == goes_on


def test_heartbeat_from_before_award_leaves_run_alone() -> None:
    word = after_a_hold_up()
    assert not word.on_heartbeat(NOBODYS, None, 2.2)
    # The goal arrives before a heartbeat that was sent before it.
    assert not word.on_heartbeat(NOBODYS, MINE, 2.4)
    assert not word.on_heartbeat(MINE, MINE, 2.6)
    assert word.hold_off_s(MINE, 2.6) == 0.0


def test_message_queued_during_stall_confirms_nothing() -> None:
    word = after_a_hold_up(MINE)
    assert not word.on_heartbeat(MINE, MINE, 2.1)
    assert word.hold_off_s(MINE, 2.4) > 0.0


def test_market_that_never_named_run_is_not_awaited() -> None:
    word = after_a_hold_up()
    assert word.hold_off_s(MINE, 2.2) == pytest.approx(0.1)
    assert word.hold_off_s(MINE, 2.4) == 0.0


def test_any_heartbeat_confirms_without_a_run() -> None:
    word = after_a_hold_up(MINE)
    assert not word.on_heartbeat(STRANGE, None, 2.5)
    assert word.stall.confirmed


@pytest.mark.parametrize(("said", "over"), [(MINE, False), (LATER, True), (STRANGE, False)])
def test_round_is_over_once_market_names_later_one(said: RunKey, over: bool) -> None:
    word = AwardMonitor(0.0)
    word.on_heartbeat(said, None, 0.0)
    assert word.is_over(MINE) == over


RUN = [("begin", "a", 0.0)]
HEARD = ("on_heartbeat", "a", 0.0)
HEARD_LATER = [*RUN, ("on_heartbeat", "a", 0.5)]
LEASES: dict[str, tuple[list[tuple[Any, ...]], float, float]] = {
    "without a run nobody is missed": ([], 9.0, 0.0),
    "the goal is a sign of life": ([("begin", "a", 5.0)], 5.9, 0.0),
    "also of a market without a heartbeat": ([("begin", "a", 5.0)], 6.0, 1.0),
    "silent from the start of the run": ([HEARD, ("begin", "a", 5.0)], 6.0, 1.0),
    "within the lease of a heartbeat": ([*RUN, ("on_heartbeat", "a", 0.4)], 1.3, 0.0),
    "the lease is over to the second": (HEARD_LATER, 1.5, 1.0),
    "another market says nothing": ([*HEARD_LATER, ("on_heartbeat", "b", 1.25)], 1.5, 1.0),
    "only the other one is known": ([*RUN, ("on_heartbeat", "b", 0.5)], 1.0, 1.0),
    "the run is over": ([HEARD, *RUN, ("end",)], 9.0, 0.0),
    "whoever was held up waits half a lease": ([HEARD, *RUN, ("extend", 0.5, 4.0)], 4.25, 0.0),
    "and for no longer": ([HEARD, *RUN, ("extend", 0.5, 4.0)], 4.5, 1.0),
    "a short delay does not count": ([*HEARD_LATER, ("extend", 0.75, 1.25)], 1.7, 0.0),
    "and extends the lease by its length": ([*HEARD_LATER, ("extend", 0.75, 1.25)], 1.8, 1.0),
    "a lease that was over is not renewed": ([HEARD, *RUN, ("extend", 1.5, 4.0)], 4.0, 4.0),
}
"""Name → calls of the lease, the time, and how long the market is silent by then."""


@pytest.mark.parametrize(("calls", "now", "silence"), LEASES.values(), ids=LEASES)
def test_silence_is_measured_from_last_heartbeat(
    calls: list[tuple[Any, ...]], now: float, silence: float
) -> None:
    lease = MarketLease(1.0)
    for method, *given in calls:
        getattr(lease, method)(*given)
    assert lease.silence(now) == pytest.approx(silence)


def test_changed_lease_takes_effect_immediately() -> None:
    lease = MarketLease(1.0)
    lease.begin("a", 0.0)
    lease.on_heartbeat("a", 0.0)
    assert lease.silence(0.5) == 0.0
    lease.lease_s = 0.5
    assert lease.silence(0.5) == 0.5
