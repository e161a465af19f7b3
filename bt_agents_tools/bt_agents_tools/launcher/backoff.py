# SPDX-License-Identifier: Apache-2.0
"""How long to wait before a process that has ended is started again."""

from __future__ import annotations

FIRST_S = 0.5
MOST_S = 30.0
STEADY_S = 60.0


class Backoff:
    """Waits twice as long after each end, and begins anew after a life that was long enough."""

    def __init__(self) -> None:
        self._next_s = FIRST_S

    def ended(self, lived_s: float) -> float:
        """Return how long to wait now [s].

        Args:
            lived_s: From the start of the process to its end [s].
        """
        if lived_s >= STEADY_S:
            self._next_s = FIRST_S
        wait_s = self._next_s
        self._next_s = min(2 * wait_s, MOST_S)
        return wait_s
