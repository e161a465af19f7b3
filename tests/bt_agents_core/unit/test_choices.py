# SPDX-License-Identifier: Apache-2.0
"""Choices of a question: which answers match."""

from __future__ import annotations

import pytest

from bt_agents_core.choices import counted_answer


@pytest.mark.parametrize(
    ("said", "taken"), [("yes", "Yes"), (" NO", " No "), ("maybe", ""), ("", ""), (" ", "")]
)
def test_answer_matches_choices_case_insensitively(said: str, taken: str) -> None:
    assert counted_answer(said, ("Yes", " No ")) == taken


def test_any_answer_counts_without_choices() -> None:
    assert counted_answer(" Gate 12 ", ()) == "Gate 12"
    assert counted_answer("  ", ()) == ""


def test_composed_and_decomposed_accents_match():
    composed, decomposed = "Caf\u00e9", "cafe\u0301"
    assert counted_answer(decomposed, ("bar", composed)) == composed
    assert counted_answer(composed, ("bar", decomposed)) == decomposed
