# SPDX-License-Identifier: Apache-2.0
"""The protocol: its messages, refusals of a client's, and requests for recorded moments."""

from __future__ import annotations

import json
import math

import pytest

from bt_agents_core.errors import Refused
from bt_agents_studio.feed import Feed
from bt_agents_studio.history import History
from bt_agents_studio.protocol import (
    LARGEST_MESSAGE,
    VERSION,
    Delta,
    Follow,
    Resume,
    Seek,
    Snapshot,
    decode,
    encode,
)
from bt_agents_studio.records import MoodRecord, QuestionRecord, QuestionsRecord
from bt_agents_studio.store import Store


def test_delta_carries_records_as_objects() -> None:
    question = QuestionRecord(at_s=1.5, text="<b>Ready?</b>", choices=("yes", "no"))
    record = QuestionsRecord(questions=(question,))
    changes = (("questions", "", record), ("nodes", "a|tree", None))
    assert json.loads(encode(Delta(sequence=7, changes=changes))) == {
        "type": "delta",
        "sequence": 7,
        "changes": [
            [
                "questions",
                "",
                {"questions": [{"at_s": 1.5, "text": "<b>Ready?</b>", "choices": ["yes", "no"]}]},
            ],
            ["nodes", "a|tree", None],
        ],
    }


def test_nan_is_never_sent() -> None:
    change = ("moods", "1", MoodRecord(at_s=0.0, mood=math.nan))
    with pytest.raises(ValueError, match="not JSON compliant"):
        encode(Delta(sequence=1, changes=(change,)))


def test_client_messages_are_decoded() -> None:
    resume = json.dumps({"type": "resume", "version": VERSION, "studio": "a", "sequence": 3})
    assert decode(resume) == Resume(version=VERSION, studio="a", sequence=3)
    assert decode('{"type":"seek","source":"","at_s":12}') == Seek(source="", at_s=12)
    assert decode('{"type":"follow"}') == Follow()


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "NOT_JSON"),
        ("[" * 3000, "NOT_JSON"),
        ("null", "UNKNOWN_TYPE"),
        ('{"type":["resume"]}', "UNKNOWN_TYPE"),
        ('{"type":"hello"}', "UNKNOWN_TYPE"),
        ('{"type":"resume"}', "BAD_FIELD"),
        ('{"type":"resume","version":true,"studio":"","sequence":0}', "BAD_FIELD"),
        ('{"type":"resume","version":1,"studio":7,"sequence":0}', "BAD_FIELD"),
        ('{"type":"resume","version":1,"studio":"","sequence":-1}', "BAD_FIELD"),
        ('{"type":"resume","version":1,"studio":"","sequence":1e3}', "BAD_FIELD"),
        ('{"type":"resume","version":1,"studio":"","sequence":0,"role":"author"}', "BAD_FIELD"),
        ('{"type":"seek","source":"","at_s":NaN}', "BAD_FIELD"),
        ('{"type":"seek","source":"","at_s":1e300}', "BAD_FIELD"),
        ('{"type":"seek","source":"","at_s":"now"}', "BAD_FIELD"),
        ('{"type":"seek","source":"' + "a" * 300 + '","at_s":1}', "BAD_FIELD"),
        ('{"type":"follow","at_s":1}', "BAD_FIELD"),
        (" " * (LARGEST_MESSAGE + 1), "TOO_LARGE"),
    ],
)
def test_malformed_message_is_rejected_with_code(text: str, code: str) -> None:
    with pytest.raises(Refused) as refused:
        decode(text)
    assert refused.value.code == code


# --- recorded moments -------------------------------------------------------------------------

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
