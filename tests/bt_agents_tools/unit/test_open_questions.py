# SPDX-License-Identifier: Apache-2.0
"""Open questions: an answer goes to the first one that accepts it, or is refused."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bt_agents_core.errors import Refused
from bt_agents_tools.client.open_questions import asked_by

GO = SimpleNamespace(text="Shall we go?", choices=("Yes", "No"))
NAME = SimpleNamespace(text="What is your name?", choices=())


def test_answer_goes_to_first_question_accepting_it() -> None:
    assert asked_by([GO, NAME], " yes ") == (GO, "Yes")
    assert asked_by([GO, NAME], "Ada") == (NAME, "Ada")


@pytest.mark.parametrize(
    ("questions", "words", "code"),
    [
        ([], "yes", "NO_QUESTION"),
        ([GO], "perhaps", "NOT_A_CHOICE"),
        ([GO], "", "NOT_A_CHOICE"),
        ([NAME], " ", "NOT_A_CHOICE"),
    ],
)
def test_answer_matching_no_question_is_refused(
    questions: list[SimpleNamespace], words: str, code: str
) -> None:
    with pytest.raises(Refused, match=f"^{code}: "):
        asked_by(questions, words)
