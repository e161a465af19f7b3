# SPDX-License-Identifier: Apache-2.0
"""Limit on log lines that other processes cause, so that they do not fill the disk."""

from __future__ import annotations

from collections.abc import Callable


class LogBudget:
    """Maximum number of lines per period, which begins with its first line.

    Args:
        lines: Maximum number of lines in a period.
        period_s: Length of a period [s].
        clock: Steady time [s].
    """

    def __init__(self, lines: int, period_s: float, clock: Callable[[], float]) -> None:
        self._lines = lines
        self._period_s = period_s
        self._clock = clock
        self._left = 0
        self._until = -float("inf")

    def line(self, text: str) -> str:
        """Return the line to log; empty if the period already has enough lines.

        The last line of a period says that further ones are left out.
        """
        now = self._clock()
        if now >= self._until:
            self._until = now + self._period_s
            self._left = self._lines
        if self._left == 0:
            return ""
        self._left -= 1
        more = f" (others are left out for {self._until - now:.1f} s)"
        return text if self._left else f"{text}{more}"
