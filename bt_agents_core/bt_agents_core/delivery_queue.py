# SPDX-License-Identifier: Apache-2.0
"""Bounded at-least-once queue: one item in flight, resent until it is acknowledged."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

ContentT = TypeVar("ContentT")


class DeliveryQueue(Generic[ContentT]):
    """First-in first-out queue whose first item is sent until it is acknowledged.

    Args:
        clock: Steady time [s].
        most: Maximum number of stored items.
        answer_s: Time after which an unacknowledged item is sent again [s].
    """

    def __init__(self, clock: Callable[[], float], *, most: int, answer_s: float) -> None:
        self._clock = clock
        self._most = most
        self._answer_s = answer_s
        self._waiting: deque[ContentT] = deque()
        self._deadline: float | None = None

    def __len__(self) -> int:
        """Return the number of unacknowledged items."""
        return len(self._waiting)

    def enqueue(self, item: ContentT) -> ContentT | None:
        """Store an item; return the oldest one if it had to make room."""
        dropped = None
        if len(self._waiting) == self._most:
            dropped = self._waiting.popleft()
            self._deadline = None
        self._waiting.append(item)
        return dropped

    @property
    def next_to_send(self) -> ContentT | None:
        """The item to send now; None if there is none or its answer may still arrive."""
        if not self._waiting or (self._deadline is not None and self._clock() < self._deadline):
            return None
        return self._waiting[0]

    @property
    def overdue(self) -> bool:
        """True if the item in flight was not acknowledged in time."""
        return self._deadline is not None and self._clock() >= self._deadline

    def sent(self) -> None:
        """Start the timeout for the answer to the item that was just sent."""
        self._deadline = self._clock() + self._answer_s

    def peer_lost(self) -> None:
        """Resend the item in flight because its receiver is gone."""
        self._deadline = None

    def acknowledge(self, item: ContentT) -> bool:
        """Remove an item; return False if it is no longer the first."""
        if not self._waiting or self._waiting[0] is not item:
            return False
        self._waiting.popleft()
        self._deadline = None
        return True
