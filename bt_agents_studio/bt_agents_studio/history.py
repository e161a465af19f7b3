# SPDX-License-Identifier: Apache-2.0
"""History of a store: its contents at earlier moments."""

from __future__ import annotations

import zlib
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable

from bt_agents_studio.store import REMOVED, Change, encode_value

SPAN_S = 600.0
"""Length of a running system's history [s]."""

MOST_CHANGES = 300_000
"""Maximum number of a running system's changes to keep; the oldest go first."""

MOST_BYTES = 64 * 1024 * 1024
"""Maximum size of a running system's history [bytes]; the oldest changes go first."""

_BLOCK = 5000
_BLOCKS_OF_SPAN, _BLOCKS_OF_SIZE = 10, 8
_BEFORE = "-inf"


class History:
    """Changes of a store by time; restores the store at any moment, except its events.

    It consists of blocks of changes, each with the entries before its first change. It compresses
    complete blocks, and drops the oldest first.

    Args:
        span_s: Age from which it drops changes [s]; infinite for recordings.
        most: Maximum number of changes.
        most_bytes: Maximum size [bytes].
        block: Number of changes in a block; a block has at least as many as there are entries.
    """

    def __init__(
        self,
        span_s: float = SPAN_S,
        most: float = MOST_CHANGES,
        most_bytes: int = MOST_BYTES,
        block: int = _BLOCK,
    ) -> None:
        self._span_s = span_s
        self._most = most
        self._most_bytes = most_bytes
        self._block = block
        self._blocks: list[_Block] = []
        self._newest: dict[tuple[str, str], str] = {}
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
            if self._blocks:
                self._blocks[-1].pack()
            self._blocks.append(_Block(self._last_s, self._newest.items()))
            self._drop()
        entry = (change.collection, encode_value(change.key))
        self._blocks[-1].add(self._last_s, entry, change.value)
        if change.value == REMOVED:
            self._newest.pop(entry, None)
        else:
            self._newest[entry] = change.value

    def at(self, at_s: float) -> str:
        """Return the contents of the store at a moment [s since 1970], including its changes.

        As JSON: collection → key → value.
        """
        if not self._blocks:
            return "{}"
        number = bisect_right(self._blocks, at_s, key=lambda block: block.first_s)
        found = self._blocks[max(number - 1, 0)].at(at_s)
        return f"{{{','.join(f'{encode_value(name)}:{{{one}}}' for name, one in found.items())}}}"

    def _is_complete(self, block: _Block) -> bool:
        return (
            block.count >= max(self._block, len(self._newest))
            or block.size >= max(self._most_bytes / _BLOCKS_OF_SIZE, 2 * block.size_before)
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

    Each is a line: time, collection, key and value. The last two are JSON, which has neither tabs
    nor line ends of its own.

    Attributes:
        first_s: Time of the first change [s since 1970].
        count: Number of changes.
        size: Number of bytes.
        size_before: Number of bytes of the entries before it, uncompressed.
    """

    def __init__(self, first_s: float, before: Iterable[tuple[tuple[str, str], str]]) -> None:
        self.first_s = first_s
        self.count = 0
        self._lines = [_line_of(_BEFORE, entry, value) for entry, value in before]
        self._packed = b""
        self.size = self.size_before = sum(map(len, self._lines))

    def add(self, at_s: float, entry: tuple[str, str], value: str) -> None:
        """Add a change."""
        line = _line_of(repr(at_s), entry, value)
        self._lines.append(line)
        self.count += 1
        self.size += len(line)

    def pack(self) -> None:
        """Compress the block."""
        self._packed = zlib.compress("\n".join(self._lines).encode(), level=1)
        self._lines = []
        self.size = len(self._packed)

    def at(self, at_s: float) -> dict[str, str]:
        """Return collection → members of its JSON object at a moment [s since 1970]."""
        lines = self._lines
        if self._packed:
            lines = zlib.decompress(self._packed).decode().split("\n")
        values: dict[tuple[str, str], str] = {}
        for line in lines:
            changed_s, collection, key, value = line.split("\t")
            if float(changed_s) > at_s:
                break
            values[collection, key] = value
        found: defaultdict[str, list[str]] = defaultdict(list)
        for (collection, key), value in values.items():
            if value != REMOVED:
                found[collection].append(f"{key}:{value}")
        return {collection: ",".join(members) for collection, members in found.items()}


def _line_of(at_s: str, entry: tuple[str, str], value: str) -> str:
    return "\t".join((at_s, *entry, value))
