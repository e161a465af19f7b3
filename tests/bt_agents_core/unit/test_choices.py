# SPDX-License-Identifier: Apache-2.0
"""Choices of a question: which answers count."""

from __future__ import annotations

import pytest

from bt_agents_core.choices import counted_answer


@pytest.mark.parametrize(
    ("said", "taken"), [("yes", "Yes"), (" NO", " No "), ("maybe", ""), ("", ""), (" ", "")]
)
def test_only_a_choice_counts_in_any_case(said: str, taken: str) -> None:
    assert counted_answer(said, ("Yes", " No ")) == taken


def test_without_choices_any_words_count() -> None:
    assert counted_answer(" Gate 12 ", ()) == "Gate 12"
    assert counted_answer("  ", ()) == ""


def test_an_accent_may_be_stored_as_one_character_or_as_two():
    composed, decomposed = "Caf\u00e9", "cafe\u0301"
    assert counted_answer(decomposed, ("bar", composed)) == composed
    assert counted_answer(composed, ("bar", decomposed)) == decomposed
