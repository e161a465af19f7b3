# SPDX-License-Identifier: Apache-2.0
"""Open questions: which answers count, and what others read."""

from __future__ import annotations

import pytest

from bt_agents_core.choices import counted_answer
from bt_agents_core.errors import Refused
from bt_agents_robot.open_questions import OpenQuestion, from_json, to_json

CHOICES = OpenQuestion(text="Shall we?", choices=("Yes", " No "))


@pytest.mark.parametrize(
    ("said", "taken"), [("yes", "Yes"), (" NO", " No "), ("maybe", ""), ("", ""), (" ", "")]
)
def test_only_a_choice_counts_in_any_case(said: str, taken: str) -> None:
    assert counted_answer(said, CHOICES.choices) == taken


def test_without_choices_any_words_count() -> None:
    assert counted_answer(" Gate 12 ", ()) == "Gate 12"
    assert counted_answer("  ", ()) == ""


def test_questions_are_read_as_they_were_told() -> None:
    questions = (CHOICES, OpenQuestion(text='Wohin "genau", Änne?'))
    assert from_json(to_json(questions)) == questions
    assert from_json(to_json(())) == ()


@pytest.mark.parametrize("text", ["", "{", "5", "[5]", "null", '[{"text": 1}]', "[" * 100_000])
def test_what_is_no_list_of_questions_is_refused(text: str) -> None:
    with pytest.raises(Refused, match="UNREADABLE"):
        from_json(text)
