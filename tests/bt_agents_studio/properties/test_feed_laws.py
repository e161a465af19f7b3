# SPDX-License-Identifier: Apache-2.0
"""Laws of store, history and feed, on random changes."""

from __future__ import annotations

import json
from collections.abc import Mapping

from hypothesis import given
from hypothesis import strategies as st

from bt_agents_studio.feed import Feed
from bt_agents_studio.history import History
from bt_agents_studio.protocol import VERSION, Delta, Resume, Snapshot
from bt_agents_studio.store import Change, Store, encode_value, size_of

_PUT = st.tuples(
    st.sampled_from(["nodes", "log"]), st.sampled_from("abcdef"), st.integers(0, 3) | st.none()
)
_POLL = st.just("poll")
_GAP = st.just("gap")


class _Page:
    """A client that knows only the messages it has received."""

    def __init__(self) -> None:
        self.entries: dict[str, dict[str, object]] = {}
        self.sequence = 0

    def take(self, message: object) -> None:
        if isinstance(message, Snapshot):
            self.entries = {name: dict(values) for name, values in message.entries.items()}
            self.sequence = message.sequence
        elif isinstance(message, Delta):
            for collection, key, value in message.changes:
                values = self.entries.setdefault(collection, {})
                if value is None:
                    values.pop(key, None)
                else:
                    values[key] = value
            self.sequence = message.sequence


def _filled(entries: Mapping[str, Mapping[str, object]]) -> dict[str, dict[str, object]]:
    return {name: dict(values) for name, values in entries.items() if values}


def _change(store: Store, collection: str, key: str, value: object | None) -> None:
    if value is None:
        store.remove(collection, key)
    else:
        store.put(collection, key, value)


@given(st.lists(_PUT | _POLL | _GAP, max_size=60))
def test_polling_or_resumed_page_matches_the_store(
    steps: list[tuple[str, str, int | None] | str],
) -> None:
    store, page = Store({"log": 3}), _Page()
    feed = _connected(store, page)
    for step in steps:
        if step == "poll":
            page.take(feed.next())
        elif step == "gap":
            feed = _connected(store, page)
        else:
            _change(store, *step)
    page.take(feed.next())
    assert _filled(page.entries) == _filled(store.snapshot())
    assert feed.next() is None or not store.sequence


def _connected(store: Store, page: _Page) -> Feed:
    feed = Feed(store, History(), "studio")
    feed.take(Resume(version=VERSION, studio="studio", sequence=page.sequence))
    return feed


@given(st.lists(_PUT, max_size=60), st.integers(1, 20))
def test_resumed_page_is_complete_despite_forgotten_removals(
    steps: list[tuple[str, str, int | None]], most: int
) -> None:
    store, page = Store(most_removals=most), _Page()
    for step in steps[: len(steps) // 2]:
        _change(store, *step)
    page.take(_connected(store, page).next())
    for step in steps[len(steps) // 2 :]:
        _change(store, *step)
    page.take(_connected(store, page).next())
    assert _filled(page.entries) == _filled(store.snapshot())


@given(
    st.lists(st.tuples(st.floats(0, 3), _PUT), max_size=80),
    st.integers(2, 60),
    st.integers(100, 10_000),
)
def test_history_reproduces_store_at_each_moment(
    steps: list[tuple[float, tuple[str, str, int | None]]], most: int, most_bytes: int
) -> None:
    history = History(20.0, most, most_bytes, block=7)
    now = 0.0
    changes: list[Change] = []
    store = Store(None, changes.append)
    moments = []
    for wait, step in steps:
        now += wait
        _change(store, *step)
        for change in changes:
            history.record(now, change)
        changes.clear()
        moments.append((now, _filled(store.snapshot())))
    last = dict(moments)
    for at_s, entries in last.items():
        if history.first_s is not None and at_s >= history.first_s:
            assert json.loads(history.at(at_s)) == entries


_KEY = st.sampled_from([f"{use}{number}" for use in ("used", "other") for number in range(6)])


@given(st.lists(st.tuples(st.sampled_from(["nodes", "log"]), _KEY, st.text(max_size=300))))
def test_bounded_store_keeps_entries_in_use(steps: list[tuple[str, str, str]]) -> None:
    store = Store(
        {"log": 3}, most_bytes=2000, is_in_use=lambda _store, _name, key: key.startswith("used")
    )
    for collection, key, value in steps:
        before = store.snapshot()
        store.put(collection, key, value)
        after = store.snapshot()
        assert len(after.get("log", {})) <= 3
        entries = [pair for entries in after.values() for pair in entries.items()]
        assert sum(size_of(key, encode_value(value)) for key, value in entries) <= 2000
        lost = [one for name in before for one in before[name] if one not in after.get(name, {})]
        if any(one.startswith("used") and one != key for one in lost):
            raise AssertionError(f"{lost} left for {key}")
