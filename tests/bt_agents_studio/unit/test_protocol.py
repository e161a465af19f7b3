# SPDX-License-Identifier: Apache-2.0
"""The protocol: its messages, and refusals of a client's messages."""

from __future__ import annotations

import json
import math

import pytest

from bt_agents_core.errors import Refused
from bt_agents_studio.protocol import (
    LARGEST_MESSAGE,
    VERSION,
    Delta,
    Follow,
    Resume,
    Seek,
    decode,
    encode,
)
from bt_agents_studio.records import MoodRecord, QuestionRecord, QuestionsRecord


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
        ("[]", "UNKNOWN_TYPE"),
        ('"resume"', "UNKNOWN_TYPE"),
        ("{}", "UNKNOWN_TYPE"),
        ('{"type":["resume"]}', "UNKNOWN_TYPE"),
        ('{"type":"hello"}', "UNKNOWN_TYPE"),
        ('{"type":"resume"}', "BAD_FIELD"),
        ('{"type":"resume","version":true,"studio":"","sequence":0}', "BAD_FIELD"),
        ('{"type":"resume","version":1,"studio":7,"sequence":0}', "BAD_FIELD"),
        ('{"type":"resume","version":1,"studio":"","sequence":-1}', "BAD_FIELD"),
        ('{"type":"resume","version":1,"studio":"","sequence":1e3}', "BAD_FIELD"),
        ('{"type":"resume","version":1,"studio":"","sequence":0,"role":"author"}', "BAD_FIELD"),
        ('{"type":"seek","source":"","at_s":NaN}', "BAD_FIELD"),
        ('{"type":"seek","source":"","at_s":Infinity}', "BAD_FIELD"),
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
