# SPDX-License-Identifier: Apache-2.0
"""Store of all that a studio shows: entries by collection and key, and what changed since when."""

from __future__ import annotations

from collections import OrderedDict, defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

MOST_REMOVALS = 5000
"""Removals that are remembered; whoever has missed an older one needs a snapshot."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Change:
    """New value of one entry; None: it is removed."""

    collection: str
    key: str
    value: object | None


Entries = Mapping[str, Mapping[str, object]]
"""All entries of a moment: collection → key → value."""


class Store:
    """Entries by collection and key, each with the number of its last change.

    Args:
        most: Collection → entries that it holds at most; the oldest are removed first. Those that
            are not named are not bounded.
        on_change: Called with each change, after it was made.
        most_removals: Removals that are remembered.

    Attributes:
        sequence: Number of the last change; 0 before the first.
    """

    def __init__(
        self,
        most: Mapping[str, int] | None = None,
        on_change: Callable[[Change], None] | None = None,
        most_removals: int = MOST_REMOVALS,
    ) -> None:
        self.sequence = 0
        self._most = most or {}
        self._on_change = on_change
        self._most_removals = most_removals
        self._collections: defaultdict[str, dict[str, object]] = defaultdict(dict)
        # The last change of each entry and of what is removed, the newest last.
        self._changed: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._removed: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._forgotten = 0

    def get(self, collection: str, key: str = "") -> object | None:
        """Return the value of an entry, None for none."""
        return self._collections[collection].get(key)

    def keys(self, collection: str) -> tuple[str, ...]:
        """Return the keys of a collection in the order in which they were entered."""
        return tuple(self._collections[collection])

    def put(self, collection: str, key: str, value: object) -> None:
        """Enter or replace an entry; an equal value is no change."""
        entries = self._collections[collection]
        if entries.get(key) == value:
            return
        entries[key] = value
        self._removed.pop((collection, key), None)
        self._note(Change(collection=collection, key=key, value=value))
        most = self._most.get(collection, len(entries))
        while len(entries) > most:
            self.remove(collection, next(iter(entries)))

    def remove(self, collection: str, key: str) -> None:
        """Remove an entry, if it is there."""
        if self._collections[collection].pop(key, None) is None:
            return
        self._note(Change(collection=collection, key=key, value=None))
        self._removed[collection, key] = self.sequence
        while len(self._removed) > self._most_removals:
            oldest, self._forgotten = self._removed.popitem(last=False)
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
