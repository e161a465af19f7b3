# SPDX-License-Identifier: Apache-2.0
"""Lease of a host on the market of its run, in tables on a manual clock."""

from __future__ import annotations

import pytest

from bt_agents.host.award_monitor import MarketLease

BEGIN, HEARD, HELD_UP, END = "begin", "heard", "held up since", "end"
RUN = [(BEGIN, 0.0, "a")]
HEARD_RUN = [(HEARD, 0.0, "a"), *RUN]
SHORT_DELAY = [*RUN, (HEARD, 0.5, "a"), (HELD_UP, 1.25, 0.75)]


LEASES: dict[str, tuple[list[tuple[str, float, object]], float, float]] = {
    "without a run nobody is missed": ([], 9.0, 0.0),
    "the goal is a sign of life": ([(BEGIN, 5.0, "a")], 5.9, 0.0),
    "also of a market without a heartbeat": ([(BEGIN, 5.0, "a")], 6.0, 1.0),
    "silent from the start of the run": ([(HEARD, 0.0, "a"), (BEGIN, 5.0, "a")], 6.0, 1.0),
    "within the lease of a heartbeat": ([*RUN, (HEARD, 0.4, "a")], 1.3, 0.0),
    "the lease is over to the second": ([*RUN, (HEARD, 0.5, "a")], 1.5, 1.0),
    "another market says nothing about this one": (
        [*RUN, (HEARD, 0.5, "a"), (HEARD, 1.25, "b")],
        1.5,
        1.0,
    ),
    "only the other one is known": ([*RUN, (HEARD, 0.5, "b")], 1.0, 1.0),
    "the run is over": ([*HEARD_RUN, (END, 1.0, "")], 9.0, 0.0),
    "whoever was held up waits for half of a lease": (
        [*HEARD_RUN, (HELD_UP, 4.0, 0.5)],
        4.25,
        0.0,
    ),
    "and for no longer": ([*HEARD_RUN, (HELD_UP, 4.0, 0.5)], 4.5, 1.0),
    "a short delay does not count": (SHORT_DELAY, 1.7, 0.0),
    "and extends the lease by its length only": (SHORT_DELAY, 1.8, 1.0),
    "a lease that was over before is not renewed": ([*HEARD_RUN, (HELD_UP, 4.0, 1.5)], 4.0, 4.0),
}


@pytest.mark.parametrize(("events", "now", "silence"), LEASES.values(), ids=LEASES)
def test_silence_is_measured_from_last_heartbeat(
    events: list[tuple[str, float, object]], now: float, silence: float
) -> None:
    lease = MarketLease(1.0)
    for kind, at, what in events:
        match kind:
            case "begin":
                lease.begin(str(what), at)
            case "heard":
                lease.on_heartbeat(str(what), at)
            case "held up since":
                assert isinstance(what, float)
                lease.extend(what, at)
            case "end":
                lease.end()
    assert lease.silence(now) == pytest.approx(silence)


def test_changed_lease_takes_effect_immediately() -> None:
    lease = MarketLease(1.0)
    lease.begin("a", 0.0)
    lease.on_heartbeat("a", 0.0)
    assert lease.silence(0.5) == 0.0
    lease.lease_s = 0.5
    assert lease.silence(0.5) == 0.5
