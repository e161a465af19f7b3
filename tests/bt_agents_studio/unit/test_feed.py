# SPDX-License-Identifier: Apache-2.0
"""Requests for recorded moments: one is read at a time, and the last one counts."""

from __future__ import annotations

import pytest

from bt_agents_studio.feed import Feed
from bt_agents_studio.history import History
from bt_agents_studio.protocol import VERSION, Follow, Resume, Seek, Snapshot
from bt_agents_studio.store import Store

FILE = "journal-2026-03-01_001.mcap"


@pytest.fixture
def feed() -> Feed:
    feed = Feed(Store(), History(), "studio")
    feed.take(Resume(version=VERSION, studio="", sequence=0))
    feed.next()
    return feed


def seek(at_s: float, source: str = FILE) -> Seek:
    return Seek(source=source, at_s=at_s)


def test_only_one_moment_is_read_and_last_counts(feed: Feed) -> None:
    feed.take(seek(1))
    assert feed.take_recorded() == seek(1)
    for at_s in (2, 3):
        feed.take(seek(at_s))
        assert feed.take_recorded() is None
        assert feed.next() is None
    feed.give("first")
    assert feed.next() == "first"
    assert feed.take_recorded() == seek(3)
    assert feed.take_recorded() is None
    feed.give("last")
    assert (feed.next(), feed.next(), feed.take_recorded()) == ("last", None, None)


def test_moment_stays_due_until_recording_is_whole(feed: Feed) -> None:
    feed.take(seek(1))
    for part in ("a", "b"):
        assert feed.take_recorded() == seek(1)
        feed.give(part, is_whole=False)
        assert feed.next() == part
    assert feed.take_recorded() == seek(1)
    feed.give("all")
    assert (feed.next(), feed.take_recorded()) == ("all", None)


@pytest.mark.parametrize("wish", [Follow(), seek(1, "other.mcap"), seek(1, "")])
def test_other_wish_discards_moment_being_read(feed: Feed, wish: Follow | Seek) -> None:
    feed.take(seek(1))
    feed.take_recorded()
    feed.take(wish)
    for is_failure in (False, True):
        feed.give("late", is_failure=is_failure)
    assert feed.next() != "late"


def test_unreadable_recording_leads_back_to_now(feed: Feed) -> None:
    feed.take(seek(1))
    feed.take_recorded()
    feed.give("why not", is_failure=True)
    assert feed.next() == "why not"
    assert isinstance(feed.next(), Snapshot)


def test_failure_of_earlier_wish_is_not_told(feed: Feed) -> None:
    feed.take(seek(1))
    feed.take_recorded()
    feed.take(seek(2))
    feed.give("why not", is_failure=True)
    assert feed.next() is None
    assert feed.take_recorded() == seek(2)
