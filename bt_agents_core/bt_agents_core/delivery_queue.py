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
        most: Items that are stored.
        answer_s: An item that is not acknowledged for so long is sent again [s].
    """

    def __init__(self, clock: Callable[[], float], *, most: int, answer_s: float) -> None:
        self._clock = clock
        self._most = most
        self._answer_s = answer_s
        self._waiting: deque[ContentT] = deque()
        self._deadline: float | None = None

    def __len__(self) -> int:
        """Return how many are not acknowledged yet."""
        return len(self._waiting)

    def enqueue(self, item: ContentT) -> ContentT | None:
        """Store an item; return the oldest one when it had to make room."""
        dropped = None
        if len(self._waiting) == self._most:
            dropped = self._waiting.popleft()
            self._deadline = None
        self._waiting.append(item)
        return dropped

    @property
    def next_to_send(self) -> ContentT | None:
        """The item to send now; None when there is none, or its answer can still come."""
        if not self._waiting or (self._deadline is not None and self._clock() < self._deadline):
            return None
        return self._waiting[0]

    @property
    def overdue(self) -> bool:
        """True when the answer to the item in flight has not come in time."""
        return self._deadline is not None and self._clock() >= self._deadline

    def sent(self) -> None:
        """Start the time for an answer, as the next item is on its way."""
        self._deadline = self._clock() + self._answer_s

    def peer_lost(self) -> None:
        """Have the item in flight sent again, as its receiver has gone."""
        self._deadline = None

    def acknowledge(self, item: ContentT) -> bool:
        """Take an item out; return False for one that is not the first any more."""
        if not self._waiting or self._waiting[0] is not item:
            return False
        self._waiting.popleft()
        self._deadline = None
        return True
