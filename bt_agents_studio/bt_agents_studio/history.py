# SPDX-License-Identifier: Apache-2.0
"""History of a store: its contents at earlier moments."""

from __future__ import annotations

import json
import zlib
from bisect import bisect_right
from collections.abc import Iterable

from bt_agents_studio.store import Change

SPAN_S = 600.0
"""Length of a running system's history [s]."""

MOST_CHANGES = 300_000
"""Maximum number of a running system's changes to keep; the oldest go first."""

MOST_BYTES = 64 * 1024 * 1024
"""Maximum size of the changes of a running system to keep [bytes]; the oldest go first."""

_BLOCK = 5000
_BLOCKS_OF_SPAN, _BLOCKS_OF_SIZE = 10, 8
_CHANGE = 200
"""Bytes of a change in addition to its key and its value."""

_Entries = dict[tuple[str, str], object]


class History:
    """Changes of a store by time; restores the store at any moment, except its events.

    It consists of blocks of changes, each with the entries before its first change. It drops the
    oldest block first.

    Args:
        span_s: Age from which it drops changes [s]; infinite for recordings.
        most: Maximum number of changes.
        most_bytes: Maximum size of the changes [bytes].
        block: Number of changes in a block; a block has at least as many as there are entries.
        is_packed: Whether it compresses each complete block, and returns the values in it as
            plain data, as they are in JSON.
    """

    def __init__(
        self,
        span_s: float = SPAN_S,
        most: float = MOST_CHANGES,
        most_bytes: int = MOST_BYTES,
        block: int = _BLOCK,
        *,
        is_packed: bool = False,
    ) -> None:
        self._span_s = span_s
        self._most = most
        self._most_bytes = most_bytes
        self._block = block
        self._is_packed = is_packed
        self._blocks: list[_Block] = []
        self._newest: _Entries = {}
        self._last_s = 0.0

    @property
    def first_s(self) -> float | None:
        """Earliest available moment [s since 1970]; None if there is none."""
        return self._blocks[0].first_s if self._blocks else None

    @property
    def last_s(self) -> float | None:
        """Time of the last change [s since 1970]; None before the first."""
        return self._last_s if self._blocks else None

    def record(self, at_s: float, change: Change) -> None:
        """Record a change; a clock that goes back counts as one that stands still."""
        self._last_s = max(at_s, self._last_s)
        if change.collection == "events":
            return
        if not self._blocks or self._is_complete(self._blocks[-1]):
            if self._blocks and self._is_packed:
                self._blocks[-1].pack()
            self._blocks.append(_Block(self._last_s, dict(self._newest)))
            self._drop()
        self._blocks[-1].add(self._last_s, change)
        _apply(self._newest, change.collection, change.key, change.value)

    def at(self, at_s: float) -> dict[str, dict[str, object]]:
        """Return the contents of the store at a moment [s since 1970], including its changes."""
        found: dict[str, dict[str, object]] = {}
        if not self._blocks:
            return found
        number = bisect_right(self._blocks, at_s, key=lambda block: block.first_s)
        for (collection, key), value in self._blocks[max(number - 1, 0)].at(at_s).items():
            found.setdefault(collection, {})[key] = value
        return found

    def _is_complete(self, block: _Block) -> bool:
        return (
            block.count >= max(self._block, len(self._newest))
            or block.size * _BLOCKS_OF_SIZE >= self._most_bytes
            or self._last_s - block.first_s >= self._span_s / _BLOCKS_OF_SPAN
        )

    def _drop(self) -> None:
        count = sum(block.count for block in self._blocks)
        size = sum(block.size for block in self._blocks)
        while len(self._blocks) > 1 and (
            count > self._most
            or size > self._most_bytes
            or self._blocks[1].first_s <= self._last_s - self._span_s
        ):
            oldest = self._blocks.pop(0)
            count, size = count - oldest.count, size - oldest.size


class _Block:
    """Consecutive changes, and the entries before them.

    Attributes:
        first_s: Time of the first change [s since 1970].
        count: Number of changes.
        size: Bytes of the changes; of a packed block, of everything.
    """

    def __init__(self, first_s: float, before: _Entries) -> None:
        self.first_s = first_s
        self.count = 0
        self.size = 0
        self._before = before
        self._changes: list[tuple[float, str, str, object | None]] = []
        self._packed = b""

    def add(self, at_s: float, change: Change) -> None:
        """Add a change."""
        self._changes.append((at_s, change.collection, change.key, change.value))
        self.count += 1
        self.size += _CHANGE + change.size

    def pack(self) -> None:
        """Compress the block."""
        before = [(*entry, value) for entry, value in self._before.items()]
        text = json.dumps((before, self._changes), default=vars, separators=(",", ":"))
        self._packed = zlib.compress(text.encode(), level=1)
        self._before, self._changes = {}, []
        self.size = len(self._packed)

    def at(self, at_s: float) -> _Entries:
        """Return the entries at a moment [s since 1970]."""
        entries = dict(self._before)
        changes: Iterable[tuple[float, str, str, object | None]] = self._changes
        if self._packed:
            before, changes = json.loads(zlib.decompress(self._packed))
            entries = {(collection, key): value for collection, key, value in before}
        for changed_s, collection, key, value in changes:
            if changed_s > at_s:
                break
            _apply(entries, collection, key, value)
        return entries


def _apply(entries: _Entries, collection: str, key: str, value: object | None) -> None:
    if value is None:
        entries.pop((collection, key), None)
    else:
        entries[collection, key] = value
