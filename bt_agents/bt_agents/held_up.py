# SPDX-License-Identifier: Apache-2.0
"""Notices that this process was held up, so that it does not act on what is long over."""

from __future__ import annotations


class HeldUp:
    """Compares the times at which it is looked at; all are on the steady clock [s].

    Args:
        now: The time.
        limit_s: Nobody looked for longer than this: the process was held up.
        calm_s: How long afterwards to wait for news of what has happened meanwhile.

    Attributes:
        lasted_s: How long it was held up last.
        sure: False after that until somebody who was not has confirmed what holds now.
    """

    def __init__(self, now: float, *, limit_s: float = 0.5, calm_s: float = 0.3) -> None:
        self.lasted_s = 0.0
        self.sure = True
        self._last = now
        self._limit_s = limit_s
        self._calm_s = calm_s
        self._until = now

    def wait_s(self, now: float) -> float:
        """Look at the time; return how long not to act, 0 for not at all [s]."""
        gap, self._last = now - self._last, now
        if gap > self._limit_s:
            self.lasted_s = gap
            self.sure = False
            self._until = now + self._calm_s
        return max(0.0, self._until - now)
