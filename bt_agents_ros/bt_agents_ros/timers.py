# SPDX-License-Identifier: Apache-2.0
"""Steady timers for deadlines, leases and polls; simulated time does not touch them."""

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

    Without ``running`` it is created cancelled; ``reset`` starts it.
    """
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period_s, callback, clock=steady, autostart=running)


class OneShot:
    """Steady timer that fires once, at a time that may be moved."""

    def __init__(self, node: Node, callback: Callable[[], None]) -> None:
        self._callback = callback
        self._at = math.inf
        self._timer = steady_timer(node, 1.0, self._fire, running=False)

    def set(self, at: float) -> None:
        """Set the time to fire, on the steady clock [s]; infinity stops the timer.

        It fires after a day at most, also when the time is further ahead.
        """
        if at == self._at:
            return
        self._at = at
        if at == math.inf:
            self._timer.cancel()
            return
        # A period of zero never fires.
        wait_s = min(at - time.monotonic(), _DAY_S)
        self._timer.timer_period_ns = max(1, int(wait_s * 1e9))
        self._timer.reset()

    def _fire(self) -> None:
        self._timer.cancel()
        self._at = math.inf
        self._callback()
