# SPDX-License-Identifier: Apache-2.0
"""Store of all that a studio shows: entries by collection and key, and what changed since when."""

from __future__ import annotations

import math
import sys
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from json.encoder import encode_basestring
from operator import attrgetter

MOST_ENTRIES = 20_000
"""Entries of a collection without a bound of its own."""

MOST_BYTES = 32 * 1024 * 1024
"""Bytes of all entries, by :func:`size_of`."""

MOST_REMOVALS = 5000
"""Removals that are remembered; a page that has missed an older one needs a snapshot."""

_MOST_REMOVED_BYTES = 4 * 1024 * 1024
_LOOKS = 100
"""Entries of a collection that are looked at for one that is not in use."""

_NUMBER, _OBJECT = 32, 100
"""Bytes of a number, and of a collection or a record beside what is in it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Change:
    """New value of one entry; None: it is removed. ``size`` is that of key and value [bytes]."""

    collection: str
    key: str
    value: object | None
    size: int = 0


Entries = Mapping[str, Mapping[str, object]]
"""All entries of a moment: collection → key → value."""


class Store:
    """Entries by collection and key, each with the number of its last change.

    It is bounded, whatever comes in. A collection that has too many entries loses the one that has
    not changed for longest; when all entries together are too large, the largest collection does.
    An entry that is in use stays, and where all are, the one that was to be entered is left out,
    as is one that would take more than half of the room.

    Args:
        most: Collection → entries that it holds at most, if not :data:`MOST_ENTRIES`.
        on_change: Called with each change, after it was made.
        most_removals: Removals that are remembered.
        most_bytes: Bytes of all entries.
        is_in_use: Returns whether an entry of this store is, by collection and key.

    Attributes:
        sequence: Number of the last change; 0 before the first.
        dropped: Collection → entries that there was no room for.
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
        # Size of each entry, that which has not changed for longest first, and of all of them.
        self._sizes: defaultdict[str, OrderedDict[str, int]] = defaultdict(OrderedDict)
        self._bytes: Counter[str] = Counter()
        # The last change of each entry and of what is removed, the newest last.
        self._changed: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._removed: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._removed_bytes = 0
        self._forgotten = 0

    def get(self, collection: str, key: str = "") -> object | None:
        """Return the value of an entry, None for none."""
        return self._collections[collection].get(key)

    def keys(self, collection: str) -> tuple[str, ...]:
        """Return the keys of a collection in the order in which they were entered."""
        return tuple(self._collections[collection])

    def put(self, collection: str, key: str, value: object) -> None:
        """Enter or replace an entry; an equal value is no change.

        Raises:
            ValueError: A number of it is not finite, so that no page could be sent it.
        """
        entries, sizes = self._collections[collection], self._sizes[collection]
        if entries.get(key) == value:
            return
        size = size_of(key) + size_of(value)
        if size > self._most_bytes // 2:
            self.dropped[collection] += 1
            return
        entries[key] = value
        self._bytes[collection] += size - sizes.get(key, 0)
        sizes[key] = size
        sizes.move_to_end(key)
        if self._removed.pop((collection, key), None) is not None:
            self._removed_bytes -= size_of(key)
        self._note(Change(collection=collection, key=key, value=value, size=size))
        most = self._most.get(collection, MOST_ENTRIES)
        while len(entries) > most:
            self._drop(collection, key, [collection])
        while self._bytes.total() > self._most_bytes:
            self._drop(collection, key, [name for name, _ in self._bytes.most_common()])

    def remove(self, collection: str, key: str) -> None:
        """Remove an entry, if it is there."""
        if self._collections[collection].pop(key, None) is None:
            return
        self._bytes[collection] -= self._sizes[collection].pop(key)
        size = size_of(key)
        self._note(Change(collection=collection, key=key, value=None, size=size))
        self._removed[collection, key] = self.sequence
        self._removed_bytes += size
        while (
            len(self._removed) > self._most_removals or self._removed_bytes > _MOST_REMOVED_BYTES
        ):
            oldest, self._forgotten = self._removed.popitem(last=False)
            self._removed_bytes -= size_of(oldest[1])
            self._changed.pop(oldest, None)

    def clear(self, collection: str, prefix: str = "") -> None:
        """Remove all entries of a collection whose keys begin so."""
        for key in [key for key in self._collections[collection] if key.startswith(prefix)]:
            self.remove(collection, key)

    def snapshot(self) -> dict[str, dict[str, object]]:
        """Return all entries."""
        return {name: dict(entries) for name, entries in self._collections.items() if entries}

    def since(self, sequence: int) -> list[Change] | None:
        """Return the newest change of every entry that has changed after one.

        None when that cannot be told: a removal since then is forgotten, or there was no such
        change in this store.
        """
        if sequence < self._forgotten or sequence > self.sequence:
            return None
        found = list(self._newer(sequence))
        found.reverse()
        return found

    def _newer(self, sequence: int) -> Iterator[Change]:
        for (collection, key), number in reversed(self._changed.items()):
            if number <= sequence:
                return
            value = self._collections[collection].get(key)
            yield Change(collection=collection, key=key, value=value)

    def _note(self, change: Change) -> None:
        self.sequence += 1
        entry = (change.collection, change.key)
        self._changed[entry] = self.sequence
        self._changed.move_to_end(entry)
        if self._on_change is not None:
            self._on_change(change)

    def _drop(self, collection: str, key: str, collections: Sequence[str]) -> None:
        """Remove an entry of the first of some collections that has one that is not in use.

        Where none has, it is the one of a key that was just entered into a collection.
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
            # Its turn comes again after all others.
            sizes.move_to_end(key)
        return None


def size_of(value: object) -> int:
    """Return about how many bytes a value takes, in memory or as JSON, whichever is more.

    Raises:
        ValueError: A number is not finite, which JSON does not know.
    """
    if isinstance(value, str):
        return max(sys.getsizeof(value), len(encode_basestring(value)))
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"a number is {value}")
    if value is None or isinstance(value, int | float):
        return _NUMBER
    if isinstance(value, tuple):
        return _OBJECT + sum(map(size_of, value))
    if isinstance(value, Mapping):
        return _OBJECT + sum(size_of(key) + size_of(one) for key, one in value.items())
    kind: type = type(value)
    return _OBJECT + sum(size_of(one) for one in _fields_of(kind)(value))


@cache
def _fields_of(kind: type) -> Callable[[object], tuple[object, ...]]:
    """Return what reads all fields of a record."""
    names = [one.name for one in fields(kind)]
    read = attrgetter(*names)
    return read if len(names) > 1 else lambda record: (read(record),)
