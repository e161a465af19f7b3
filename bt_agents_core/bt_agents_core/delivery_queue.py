# SPDX-License-Identifier: Apache-2.0
"""What must arrive: kept in order, bounded, and sent one at a time until each is answered."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

ContentT = TypeVar("ContentT")


class DeliveryQueue(Generic[ContentT]):
    """Says which letter is to be sent now; the oldest first, the next one after its answer."""

    def __init__(self, clock: Callable[[], float], *, most: int, answer_s: float) -> None:
        """Start with nothing to send.

        Args:
            clock: Steady time [s].
            most: How many are kept.
            answer_s: A letter without an answer for so long is sent again [s].
        """
        self._clock = clock
        self._most = most
        self._answer_s = answer_s
        self._waiting: deque[ContentT] = deque()
        self._deadline: float | None = None

    def __len__(self) -> int:
        """Return how many have no answer yet."""
        return len(self._waiting)

    def put(self, letter: ContentT) -> ContentT | None:
        """Keep a letter; return the oldest one when it had to make room."""
        dropped = None
        if len(self._waiting) == self._most:
            dropped = self._waiting.popleft()
            self._deadline = None
        self._waiting.append(letter)
        return dropped

    @property
    def due(self) -> ContentT | None:
        """The letter to send now; None when there is none, or its answer can still come."""
        if not self._waiting or (self._deadline is not None and self._clock() < self._deadline):
            return None
        return self._waiting[0]

    @property
    def overdue(self) -> bool:
        """True when a letter was sent and its answer has not come in time."""
        return self._deadline is not None and self._clock() >= self._deadline

    def sent(self) -> None:
        """Note that the letter that was due is on its way."""
        self._deadline = self._clock() + self._answer_s

    def undelivered(self) -> None:
        """Note that whoever it was sent to has gone: it is due again."""
        self._deadline = None

    def answered(self, letter: ContentT) -> bool:
        """Take an answer; return False for a letter that is not the first one any more."""
        if not self._waiting or self._waiting[0] is not letter:
            return False
        self._waiting.popleft()
        self._deadline = None
        return True
