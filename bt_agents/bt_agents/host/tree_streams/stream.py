# SPDX-License-Identifier: Apache-2.0
"""Streams: names, schedule, expiry without subscribers, and tick statistics."""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode

MOST_STREAMS = 20
"""Most open streams of each of the two kinds per host."""

UNUSED_S = 10.0
"""How long an open stream stays without a subscriber [s]."""

LONGEST_TOPIC = 200
"""Most characters of a requested name."""

_CLOSE_ENOUGH = 0.98
"""Part of the period after which a snapshot is due, because ticks do not match it exactly."""

_TICKS = 10
"""Number of ticks over which statistics are averaged."""


@dataclass(frozen=True, kw_only=True)
class SnapshotParameters:
    """Content and rate of a snapshot stream.

    Attributes:
        period_s: Time between snapshots without changes [s]; infinite for changes only.

    Raises:
        Refused: ``NOT_A_DURATION``.
    """

    period_s: float
    blackboard_data: bool
    blackboard_activity: bool

    def __post_init__(self) -> None:
        """Check the period, which comes from outside."""
        if math.isnan(self.period_s) or self.period_s < 0.0:
            raise Refused(
                RefusalCode.NOT_A_DURATION,
                f"the snapshot period is {self.period_s}, expected a number of seconds from 0 on, "
                "or infinity for changes alone",
            )


class StreamUse:
    """Tracks whether a stream has subscribers, and since when it has none."""

    def __init__(self, now: float, *, kept: bool = False) -> None:
        self.watched = False
        self._kept = kept
        self._unused_since = now

    def update(self, subscribers: int, now: float) -> bool:
        """Update the number of subscribers; return whether the first one has just subscribed."""
        before, self.watched = self.watched, subscribers > 0
        if self.watched:
            self._unused_since = now
        return self.watched and not before

    def is_over(self, now: float) -> bool:
        """Return whether the stream was without subscribers for so long that it must be closed."""
        return not self._kept and now - self._unused_since >= UNUSED_S


class SnapshotSchedule:
    """Schedule of the snapshots of a stream."""

    def __init__(self) -> None:
        self._last = -math.inf

    def take(self, now: float, *, changed: bool, period_s: float) -> bool:
        """Return whether a snapshot is due after a tick; if so, restart the period [s]."""
        if not changed and now - self._last < _CLOSE_ENOUGH * period_s:
            return False
        self._last = now
        return True


def requested_topic(name: str) -> str:
    """Return the name of a requested snapshot stream, not yet expanded.

    Raises:
        Refused: ``TOO_LONG``.
    """
    if len(name) > LONGEST_TOPIC:
        raise Refused(
            RefusalCode.TOO_LONG,
            f"the topic has {len(name)} characters, expected at most {LONGEST_TOPIC}",
        )
    return name if name.startswith(("~", "/")) else f"~/snapshot_streams/{name}"


def check_count(streams: int) -> None:
    """Check that one more stream can be opened.

    Raises:
        Refused: ``TOO_MANY``.
    """
    if streams >= MOST_STREAMS:
        raise Refused(
            RefusalCode.TOO_MANY,
            f"there are {streams} streams, expected at most {MOST_STREAMS}; close some, or wait "
            f"{UNUSED_S:g} s, after which those without a subscriber are gone",
        )


@dataclass(frozen=True, kw_only=True)
class Spread:
    """The last value of a time, with average and variance of the recent ones [s]."""

    last: float
    average: float
    variance: float


class TickStatistics:
    """Intervals and durations of the recent ticks."""

    def __init__(self) -> None:
        self._began = -math.inf
        self._intervals: deque[float] = deque(maxlen=_TICKS)
        self._durations: deque[float] = deque(maxlen=_TICKS)

    def add(self, began: float, ended: float) -> None:
        """Add a tick with its start and end on the steady clock [s]."""
        self._intervals.append(began - self._began if self._began > -math.inf else 0.0)
        self._durations.append(ended - began)
        self._began = began

    @property
    def interval(self) -> Spread:
        """Time from start to start."""
        return _spread(self._intervals)

    @property
    def duration(self) -> Spread:
        """Time from start to end."""
        return _spread(self._durations)


def _spread(times: deque[float]) -> Spread:
    if not times:
        return Spread(last=0.0, average=0.0, variance=0.0)
    variance = statistics.variance(times) if len(times) > 1 else 0.0
    return Spread(last=times[-1], average=statistics.fmean(times), variance=variance)
