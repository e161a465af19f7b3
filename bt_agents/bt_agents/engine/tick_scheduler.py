# SPDX-License-Identifier: Apache-2.0
"""Scheduler of ticks: at a fixed rate, and soon after something has arrived."""

from __future__ import annotations

import math

REST_S = 0.002
"""Shortest time between the end of a tick and an extra one [s]."""


class TickScheduler:
    """Schedule of the next tick; the first is due at once. All times are steady [s].

    Regular ticks stay on a grid of periods; missed ones are skipped. An extra tick follows after a
    rest as long as the last tick, so a flood of messages uses at most half of the time.

    Attributes:
        due: When the next tick is due.
    """

    def __init__(self, period_s: float, now: float) -> None:
        self.due = now
        self._period_s = period_s
        self._grid = now
        self._rested = now
        self._requested = False

    def change(self, period_s: float, now: float) -> None:
        """Change the period from now on."""
        self._period_s = period_s
        self._grid = now + period_s
        self.due = min(self.due, self._grid)

    def request(self, now: float) -> None:
        """Request a tick as soon as the rest is over, because something has arrived."""
        self._requested = True
        self.due = min(self.due, max(now, self._rested))

    def now(self, now: float) -> None:
        """Request a tick at once, without a rest."""
        self.due = min(self.due, now)

    def started(self) -> None:
        """Handle the start of a tick, which answers all previous requests."""
        self._requested = False

    def finished(self, began: float, now: float, latest: float = math.inf) -> None:
        """Handle the end of a tick; ``latest`` is when time alone next ends something."""
        self._rested = now + max(now - began, REST_S)
        if now >= self._grid:
            missed = math.floor((now - self._grid) / self._period_s)
            self._grid += (missed + 1) * self._period_s
        self.due = min(self._grid, max(latest, now))
        if self._requested:
            # A request during the tick may concern a node that was already ticked.
            self.due = min(self.due, self._rested)
