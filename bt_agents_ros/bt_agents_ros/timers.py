# SPDX-License-Identifier: Apache-2.0
"""Steady timers for deadlines, leases and polls, independent of simulated time; polled futures."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from concurrent.futures import Future as ThreadFuture
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from rclpy.timer import Timer

LIMIT_S = 5.0
"""How long to wait for a future [s]; its work continues after that."""

_FUTURES_S = 0.01
_DAY_S = 86400.0
_SPREAD_S = 0.0618  # moves processes with neighbouring ids apart within each tenth of a second


def steady_timer(
    node: Node, period_s: float, callback: Callable[[], None], *, running: bool = True
) -> Timer:
    """Create a timer on the steady clock, which simulated time does not affect.

    Without ``running`` it is created in the cancelled state; ``reset`` starts it. Otherwise it
    fires at multiples of its period after a moment that all timers of a process share, so that
    they wake an idle process together, and those of other processes at other times.
    """
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    since_s = time.monotonic() - os.getpid() * _SPREAD_S
    # A timer with a period of zero never fires.
    first_s = max(period_s - since_s % period_s, 1e-6) if running else period_s
    timer = node.create_timer(first_s, callback, clock=steady, autostart=running)
    timer.timer_period_ns = int(period_s * 1e9)  # counts from the first call on
    return timer


class OneShot:
    """Steady timer that fires once, at a time that can be moved."""

    def __init__(self, node: Node, callback: Callable[[], None]) -> None:
        self._callback = callback
        self._at = math.inf
        self._timer = steady_timer(node, 1.0, self._fire, running=False)

    def set(self, at: float) -> None:
        """Set the time to fire, on the steady clock [s]; infinity stops the timer.

        It fires after at most a day, even if the time is further ahead.
        """
        if at == self._at:
            return
        self._at = at
        if at == math.inf:
            self._timer.cancel()
            return
        # A timer with a period of zero never fires.
        wait_s = min(at - time.monotonic(), _DAY_S)
        self._timer.timer_period_ns = max(1, int(wait_s * 1e9))
        self._timer.reset()

    def _fire(self) -> None:
        self._timer.cancel()
        self._at = math.inf
        self._callback()


class FuturePoller:
    """Polls the futures of other threads, because those must not call into rclpy."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._watched: list[tuple[ThreadFuture[Any], float, Callable[[str], None]]] = []
        self._timer = steady_timer(node, _FUTURES_S, self._poll, running=False)

    def watch(self, future: ThreadFuture[Any], done: Callable[[str], None]) -> None:
        """Call back once, when a future is done or :data:`LIMIT_S` has passed.

        ``done`` takes the error message, which is empty on success.
        """
        self._watched.append((future, time.monotonic() + LIMIT_S, done))
        if self._timer.is_canceled():
            self._timer.reset()

    async def error_of(self, future: ThreadFuture[Any]) -> str:
        """Wait for a future as :meth:`watch` does; return its error message, empty on success."""
        ended = Future(executor=self._node.executor)
        self.watch(future, ended.set_result)
        return str(await ended)

    def _poll(self) -> None:
        now = time.monotonic()
        ended = [one for one in self._watched if one[0].done() or now >= one[1]]
        self._watched = [one for one in self._watched if one not in ended]
        if not self._watched:
            self._timer.cancel()
        for future, _, done in ended:
            if not future.done():
                done(f"not done within {LIMIT_S:g} s, but it goes on")
            elif future.cancelled():
                done("given up")
            else:
                done(str(future.exception() or ""))
