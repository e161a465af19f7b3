# SPDX-License-Identifier: Apache-2.0
"""History of a store: its contents at earlier moments."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from itertools import islice
from typing import TypeVar

from bt_agents_studio.store import Change

_Value = TypeVar("_Value")

SPAN_S = 600.0
"""Length of a running system's history [s]."""

MOST_CHANGES = 300_000
"""Maximum number of changes to keep, whatever their time; the oldest go first."""

MOST_BYTES = 64 * 1024 * 1024
"""Maximum size of the changes of a running system to keep [bytes]; the oldest go first."""

_KEYFRAME = 5000
_CHANGE = 200
"""Bytes of a change in addition to its key and its value."""


class History:
    """Changes of a store by time; restores the store at any moment.

    Args:
        span_s: Maximum age of changes [s]; infinite for recordings.
        most: Maximum number of changes.
        keyframe: Number of changes after which it saves all entries, to which later changes are
            applied; larger if there are more entries.
        most_bytes: Maximum size of the changes [bytes].
    """

    def __init__(
        self,
        span_s: float = SPAN_S,
        most: int = MOST_CHANGES,
        keyframe: int = _KEYFRAME,
        most_bytes: int = MOST_BYTES,
    ) -> None:
        self._span_s = span_s
        self._most = most
        self._keyframe = keyframe
        self._most_bytes = most_bytes
        self._bytes = 0
        self._noted = 0
        self._base: dict[tuple[str, str], object] = {}
        self._base_s: float | None = None
        self._changes: deque[tuple[float, Change]] = deque()
        self._dropped = 0
        # Number of changes since the beginning → all entries after them.
        self._keyframes: dict[int, dict[tuple[str, str], object]] = {}
        self._newest: dict[tuple[str, str], object] = {}
        self._last_s = 0.0

    @property
    def first_s(self) -> float | None:
        """Earliest available moment [s since 1970]; None if there is none."""
        if self._base_s is not None:
            return self._base_s
        return self._changes[0][0] if self._changes else None

    @property
    def last_s(self) -> float | None:
        """Time of the last change [s since 1970]; None before the first."""
        return self._last_s if self._changes or self._base_s is not None else None

    def record(self, at_s: float, change: Change) -> None:
        """Record a change; a clock that goes back counts as one that stands still."""
        self._last_s = max(at_s, self._last_s)
        self._changes.append((self._last_s, change))
        _apply(self._newest, change)
        self._bytes += _CHANGE + change.size
        count = self._dropped + len(self._changes)
        if count - self._noted >= max(self._keyframe, len(self._newest)):
            self._noted = count
            self._keyframes[count] = dict(self._newest)
        while self._changes and (
            len(self._changes) > self._most
            or self._bytes > self._most_bytes
            or self._changes[0][0] < self._last_s - self._span_s
        ):
            self._drop()

    def at(self, at_s: float) -> dict[str, dict[str, object]]:
        """Return the contents of the store at a moment [s since 1970], including its changes."""
        count = bisect_right(self._changes, at_s, key=lambda one: one[0])
        numbers = [n for n in self._keyframes if self._dropped <= n <= self._dropped + count]
        start = max(numbers, default=self._dropped)
        entries = dict(self._keyframes[start] if numbers else self._base)
        for _, change in islice(self._changes, start - self._dropped, count):
            _apply(entries, change)
        found: dict[str, dict[str, object]] = {}
        for (collection, key), value in entries.items():
            found.setdefault(collection, {})[key] = value
        return found

    def newest(self, collection: str, kind: type[_Value]) -> tuple[_Value, ...]:
        """Return the values of a collection, all of one type, after the last change."""
        return tuple(
            value
            for (name, _), value in self._newest.items()
            if name == collection and isinstance(value, kind)
        )

    def _drop(self) -> None:
        self._base_s, change = self._changes.popleft()
        self._bytes -= _CHANGE + change.size
        _apply(self._base, change)
        self._dropped += 1
        self._keyframes.pop(self._dropped - 1, None)


def _apply(entries: dict[tuple[str, str], object], change: Change) -> None:
    if change.value is None:
        entries.pop((change.collection, change.key), None)
    else:
        entries[change.collection, change.key] = change.value
