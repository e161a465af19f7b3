# SPDX-License-Identifier: Apache-2.0
"""Store of everything that a studio shows: entries by collection and key, and their changes."""

from __future__ import annotations

import json
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import TypeVar

_Value = TypeVar("_Value")

MOST_ENTRIES = 20_000
"""Maximum number of entries of a collection without a limit of its own."""

MOST_BYTES = 32 * 1024 * 1024
"""Maximum size of all entries, by :func:`size_of` [bytes]."""

MOST_REMOVALS = 5000
"""Maximum number of removals to keep; a page that has missed an older one needs a snapshot."""

_MOST_REMOVED_BYTES = 4 * 1024 * 1024
_LOOKS = 100
"""Maximum number of entries of a collection to search for one that is not in use."""

REMOVED = "null"
"""JSON of the value of a removed entry."""

_ENTRY = 100
"""Bytes of an entry in addition to its key and its value."""

encode_value = json.JSONEncoder(default=vars, allow_nan=False, separators=(",", ":")).encode
"""Returns a value as JSON in ASCII; records become objects with the names of their fields."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Change:
    """New value of one entry, as JSON; :data:`REMOVED` if removed."""

    collection: str
    key: str
    value: str


NewValue = tuple[str, str, object | None]
"""Collection, key and newest value of a changed entry; None if it was removed."""

Entries = Mapping[str, Mapping[str, object]]
"""All entries of a moment: collection → key → value."""


class Store:
    """Entries by collection and key, each with the number of its last change.

    Its size is bounded. A collection with too many entries drops its least recently changed entry;
    if all entries together are too large, the largest collection does. Entries in use stay; if all
    are in use, the new entry is dropped, as is an entry that would take more than half of the
    room.

    Args:
        most: Collection → maximum number of entries, if not :data:`MOST_ENTRIES`.
        on_change: Called after each change.
        most_removals: Maximum number of removals to keep.
        most_bytes: Maximum size of all entries [bytes].
        is_in_use: Returns whether an entry of this store is in use, by collection and key.

    Attributes:
        sequence: Number of the last change; 0 before the first.
        dropped: Collection → number of entries that did not fit.
    """

    def __init__(
        self,
        most: Mapping[str, int] | None = None,
        on_change: Callable[[Change], None] | None = None,
        most_removals: int = MOST_REMOVALS,
        most_bytes: int = MOST_BYTES,
        is_in_use: Callable[[Store, str, str], bool] = lambda _store, _collection, _key: False,
    ) -> None:
        self.sequence = 0
        self.dropped: Counter[str] = Counter()
        self._most = most or {}
        self._on_change = on_change
        self._most_removals = most_removals
        self._most_bytes = most_bytes
        self._is_in_use = is_in_use
        self._collections: defaultdict[str, dict[str, object]] = defaultdict(dict)
        # Size of each entry, least recently changed first, and the total size.
        self._sizes: defaultdict[str, OrderedDict[str, int]] = defaultdict(OrderedDict)
        self._bytes: Counter[str] = Counter()
        # The last change of each entry and removal, newest last.
        self._changed: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._removed: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._removed_bytes = 0
        self._forgotten = 0

    def get(self, collection: str, key: str = "") -> object | None:
        """Return the value of an entry, None for none."""
        return self._collections[collection].get(key)

    def keys(self, collection: str) -> tuple[str, ...]:
        """Return the keys of a collection in order of entry."""
        return tuple(self._collections[collection])

    def values(self, collection: str, kind: type[_Value]) -> tuple[_Value, ...]:
        """Return the values of a collection, all of one type, in order of entry."""
        values = self._collections[collection].values()
        return tuple(value for value in values if isinstance(value, kind))

    def put(self, collection: str, key: str, value: object) -> None:
        """Add or replace an entry; an equal value is not a change.

        Raises:
            ValueError: One of its numbers is not finite, so it cannot be sent to a page.
        """
        entries, sizes = self._collections[collection], self._sizes[collection]
        if entries.get(key) == value:
            return
        text = encode_value(value)
        size = size_of(key, text)
        if size > self._most_bytes // 2:
            self.dropped[collection] += 1
            return
        entries[key] = value
        self._bytes[collection] += size - sizes.get(key, 0)
        sizes[key] = size
        sizes.move_to_end(key)
        if self._removed.pop((collection, key), None) is not None:
            self._removed_bytes -= size_of(key)
        self._note(Change(collection=collection, key=key, value=text))
        most = self._most.get(collection, MOST_ENTRIES)
        while len(entries) > most:
            self._drop(collection, key, [collection])
        while self._bytes.total() > self._most_bytes:
            self._drop(collection, key, [name for name, _ in self._bytes.most_common()])

    def remove(self, collection: str, key: str) -> None:
        """Remove an entry if it exists."""
        if self._collections[collection].pop(key, None) is None:
            return
        self._bytes[collection] -= self._sizes[collection].pop(key)
        size = size_of(key)
        self._note(Change(collection=collection, key=key, value=REMOVED))
        self._removed[collection, key] = self.sequence
        self._removed_bytes += size
        while (
            len(self._removed) > self._most_removals or self._removed_bytes > _MOST_REMOVED_BYTES
        ):
            oldest, self._forgotten = self._removed.popitem(last=False)
            self._removed_bytes -= size_of(oldest[1])
            self._changed.pop(oldest, None)

    def clear(self, collection: str, prefix: str = "") -> None:
        """Remove all entries of a collection whose keys have a prefix."""
        for key in [key for key in self._collections[collection] if key.startswith(prefix)]:
            self.remove(collection, key)

    def snapshot(self) -> dict[str, dict[str, object]]:
        """Return all entries."""
        return {name: dict(entries) for name, entries in self._collections.items() if entries}

    def since(self, sequence: int) -> list[NewValue] | None:
        """Return every entry that has changed since a sequence number, the last change last.

        None if that is unknown: a later removal is forgotten, or this store never had such a
        number.
        """
        if sequence < self._forgotten or sequence > self.sequence:
            return None
        later = takewhile(lambda one: one[1] > sequence, reversed(self._changed.items()))
        found = [
            (collection, key, self._collections[collection].get(key))
            for (collection, key), _ in later
        ]
        return found[::-1]

    def _note(self, change: Change) -> None:
        self.sequence += 1
        entry = (change.collection, change.key)
        self._changed[entry] = self.sequence
        self._changed.move_to_end(entry)
        if self._on_change is not None:
            self._on_change(change)

    def _drop(self, collection: str, key: str, collections: Sequence[str]) -> None:
        """Drop an entry of the first collection that has one that is not in use.

        If there is none, drop the entry that was just added.
        """
        for name in collections:
            if (unused := self._unused(name)) is not None:
                collection, key = name, unused
                break
        self.dropped[collection] += 1
        self.remove(collection, key)

    def _unused(self, collection: str) -> str | None:
        sizes = self._sizes[collection]
        for _ in range(min(_LOOKS, len(sizes))):
            key = next(iter(sizes))
            if not self._is_in_use(self, collection, key):
                return key
            # Move it to the end of the line.
            sizes.move_to_end(key)
        return None


def size_of(key: str, text: str = "") -> int:
    """Return the approximate size of an entry in memory, at least that of its JSON [bytes]."""
    return _ENTRY + 2 * (len(key) + len(text))
