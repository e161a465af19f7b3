# SPDX-License-Identifier: Apache-2.0
"""Formatting of texts for people."""

from __future__ import annotations

import math
from unicodedata import category

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_agents_core.text import (
    EXCERPT,
    counted_answer,
    ellipsize,
    excerpt,
    format_known,
    format_number,
    join_first,
    join_quoted,
    join_words,
    printable,
    printable_line,
    printable_lines,
    quote,
)


def test_ellipsis_counts_towards_maximum_length():
    assert ellipsize("a" * EXCERPT) == "a" * EXCERPT
    assert ellipsize("a" * (EXCERPT + 1)) == "a" * (EXCERPT - 1) + "…"
    assert ellipsize("abcd", 3) == "ab…"


def test_excerpt_is_one_line_without_space_before_ellipsis():
    assert excerpt(" a\n b ", 10) == "a b"
    assert excerpt("ab cdef", 4) == "ab…"


def test_quoted_text_is_one_short_line():
    assert quote("a\n  b") == "'a b'"
    assert len(quote("a" * 1000)) == EXCERPT + 2


def test_printable_line_has_no_control_characters():
    assert printable_line("a\x1b[2Jb\n\tc\u202e") == "a [2Jb c"


@pytest.mark.parametrize(
    ("words", "text"), [((), ""), (("a",), "a"), (("a", "b"), "a and b"), ("abc", "a, b and c")]
)
def test_words_join_as_in_a_sentence(words, text):
    assert join_words(words) == text
    assert join_words(words, "or") == text.replace("and", "or")


def test_only_first_of_many_words_are_shown():
    assert join_first("abcd") == "a, b, c and d"
    assert join_first("abcde") == "a, b, c, d and 1 more"
    assert join_quoted("abcde") == "'a', 'b', 'c', 'd', 'e'"
    assert join_quoted("abcdef") == "'a', 'b', 'c', 'd', 'e', …"


def test_numbers_have_few_digits_and_true_minus_sign():
    assert format_number(-1.23456789) == "−1.23457"
    assert format_number(-0.0) == "0"
    assert format_number(1.23456, 3) == "1.23"
    assert format_known(1.23456) == "1.235"
    assert format_known(math.nan) == "–"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[2J\x1b]0;x\x07", r"\x1b[2J\x1b]0;x\x07"),
        ("a\r\n\tb\x00\x7f\x9b", r"a\r\n\tb\x00\x7f\x9b"),
        ("\u202e\u2066\u200b\ufeff\u2028", r"\u202e\u2066\u200b\ufeff\u2028"),
        ("\ud800", r"\ud800"),
        ("a\u200db \u200d\u200d", r"a\u200db \u200d\u200d"),
    ],
)
def test_control_and_invisible_characters_are_escaped(text, shown):
    assert printable(text) == shown


@pytest.mark.parametrize(
    "text",
    [
        "",
        r"C:\x1b 'a' → b",
        "prêt\u202f!",
        "می\u200cخو",
        "क्\u200dष",
        "👩\u200d👧 ❤️\u200d🔥",
        "日本\u3000語",
    ],
)
def test_text_of_any_language_is_unchanged(text):
    assert printable(text) == text


def test_each_of_several_lines_is_printable():
    assert printable_lines("a\tb\n\x1b[2J\r\n") == "a\tb\n\\x1b[2J\\r\n"


@given(st.text(st.characters() | st.sampled_from("\u200c\u200d\x1b\u202eé👩")))
def test_printable_is_idempotent_and_yields_one_line(text):
    shown = printable(text)
    assert printable(shown) == shown
    assert len(shown.splitlines()) <= 1
    assert {one for one in shown if category(one)[0] == "C"} <= {"\u200c", "\u200d"}
    if text.isprintable():
        assert shown == text


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
