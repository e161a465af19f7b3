# SPDX-License-Identifier: Apache-2.0
"""Lease of a host on the market of its run, in tables on a manual clock."""

from __future__ import annotations

import pytest

from bt_agents.host.award_monitor import MarketLease

BEGIN, HEARD, HELD_UP, END = "begin", "heard", "held up since", "end"


@pytest.mark.parametrize(
    ("events", "now", "silence"),
    [
        pytest.param([], 9.0, 0.0, id="without a run nobody is missed"),
        pytest.param([(BEGIN, 5.0, "a")], 5.9, 0.0, id="the goal is a sign of life"),
        pytest.param([(BEGIN, 5.0, "a")], 6.0, 1.0, id="also of a market without a heartbeat"),
        pytest.param(
            [(HEARD, 0.0, "a"), (BEGIN, 5.0, "a")], 6.0, 1.0, id="silent from the start of the run"
        ),
        pytest.param(
            [(BEGIN, 0.0, "a"), (HEARD, 0.4, "a")], 1.3, 0.0, id="within the lease of a heartbeat"
        ),
        pytest.param(
            [(BEGIN, 0.0, "a"), (HEARD, 0.5, "a")], 1.5, 1.0, id="the lease is over to the second"
        ),
        pytest.param(
            [(BEGIN, 0.0, "a"), (HEARD, 0.5, "a"), (HEARD, 1.25, "b")],
            1.5,
            1.0,
            id="another market says nothing about this one",
        ),
        pytest.param(
            [(BEGIN, 0.0, "a"), (HEARD, 0.5, "b")], 1.0, 1.0, id="only the other one is known"
        ),
        pytest.param(
            [(HEARD, 0.0, "a"), (BEGIN, 0.0, "a"), (END, 1.0, "")], 9.0, 0.0, id="the run is over"
        ),
        pytest.param(
            [(HEARD, 0.0, "a"), (BEGIN, 0.0, "a"), (HELD_UP, 4.0, 0.5)],
            4.25,
            0.0,
            id="whoever was held up waits for half of a lease",
        ),
        pytest.param(
            [(HEARD, 0.0, "a"), (BEGIN, 0.0, "a"), (HELD_UP, 4.0, 0.5)],
            4.5,
            1.0,
            id="and for no longer",
        ),
        pytest.param(
            [(BEGIN, 0.0, "a"), (HEARD, 0.5, "a"), (HELD_UP, 1.25, 0.75)],
            1.7,
            0.0,
            id="a short delay does not count",
        ),
        pytest.param(
            [(BEGIN, 0.0, "a"), (HEARD, 0.5, "a"), (HELD_UP, 1.25, 0.75)],
            1.8,
            1.0,
            id="and extends the lease by its length only",
        ),
        pytest.param(
            [(HEARD, 0.0, "a"), (BEGIN, 0.0, "a"), (HELD_UP, 4.0, 1.5)],
            4.0,
            4.0,
            id="a lease that was over before is not renewed",
        ),
    ],
)
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
