# SPDX-License-Identifier: Apache-2.0
"""Clock of the trees: steady, or simulated under ``use_sim_time``, never going backwards."""

from __future__ import annotations

import time
from enum import Enum

from rclpy.node import Node


class _Source(Enum):
    STEADY = 1
    SIMULATED = 2
    NOT_YET = 3


class TreeClock:
    """Returns the trees' time [s]; only differences mean something.

    It is steady time, or simulated time under ``use_sim_time``. When simulated time jumps back,
    as a bag that starts again makes it, and when the source changes, the trees' time goes on from
    where it was. It stands still until the first message has come on ``/clock``.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._source = _Source.STEADY
        self._last = time.monotonic()
        self._offset = 0.0

    def __call__(self) -> float:
        """Return the time [s]."""
        source, raw = self._read()
        if source is not self._source or raw + self._offset < self._last:
            self._source = source
            self._offset = self._last - raw
        self._last = raw + self._offset
        return self._last

    def obstacle(self) -> str:
        """Return why time stands still; empty when it passes."""
        source, _ = self._read()
        if source is _Source.STEADY:
            return ""
        if source is _Source.NOT_YET or not self._node.count_publishers("/clock"):
            return "use_sim_time is set, but nothing publishes /clock"
        return ""

    def _read(self) -> tuple[_Source, float]:
        clock = self._node.get_clock()
        if not clock.ros_time_is_active:
            return _Source.STEADY, time.monotonic()
        now = float(clock.now().nanoseconds) * 1e-9
        return (_Source.SIMULATED if now else _Source.NOT_YET), now
