# SPDX-License-Identifier: Apache-2.0
"""Timers for deadlines, leases and polls, which simulated time does not touch."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer

_DAY_S = 86400.0


def steady_timer(
    node: Node, period_s: float, callback: Callable[[], None], *, running: bool = True
) -> Timer:
    """Create a timer on the steady clock, which nobody can set or stop.

    Args:
        node: Whose executor calls back.
        period_s: Time between two calls [s].
        callback: What is called.
        running: False lets it stand until its ``reset``.
    """
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period_s, callback, clock=steady, autostart=running)


class OneShot:
    """Calls back once, at a time that may be moved.

    Args:
        node: Whose executor calls back.
        callback: What is called.
    """

    def __init__(self, node: Node, callback: Callable[[], None]) -> None:
        self._callback = callback
        self._at = math.inf
        self._timer = steady_timer(node, 1.0, self._ring, running=False)

    def set(self, at: float) -> None:
        """Call back at this time on the steady clock [s], and no more for infinity.

        A time that is more than a day ahead is cut to that.
        """
        if at == self._at:
            return
        self._at = at
        if at == math.inf:
            self._timer.cancel()
            return
        # It rings early rather than never: a period of zero is none.
        wait_s = min(at - time.monotonic(), _DAY_S)
        self._timer.timer_period_ns = max(1, int(wait_s * 1e9))
        self._timer.reset()

    def _ring(self) -> None:
        self._timer.cancel()
        self._at = math.inf
        self._callback()
