# SPDX-License-Identifier: Apache-2.0
"""Futures of other threads, whose end is reported in the executor's thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future as ThreadFuture
from typing import Any

from rclpy.node import Node

from bt_agents_ros.timers import steady_timer

LIMIT_S = 5.0
"""How long a future is waited for [s]; its work goes on after that."""

_POLL_S = 0.01


class FuturePoller:
    """Polls the futures of other threads, which must not call into rclpy."""

    def __init__(self, node: Node) -> None:
        self._watched: list[tuple[ThreadFuture[Any], float, Callable[[str], None]]] = []
        self._timer = steady_timer(node, _POLL_S, self._poll, running=False)

    def watch(self, future: ThreadFuture[Any], done: Callable[[str], None]) -> None:
        """Call back once, when a future is done or :data:`LIMIT_S` has passed.

        ``done`` takes what went wrong, an empty text when nothing did.
        """
        self._watched.append((future, time.monotonic() + LIMIT_S, done))
        if self._timer.is_canceled():
            self._timer.reset()

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
