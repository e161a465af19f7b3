# SPDX-License-Identifier: Apache-2.0
"""Timers for deadlines, leases and polls, which simulated time does not touch."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer


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
