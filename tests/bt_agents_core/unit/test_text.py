# SPDX-License-Identifier: Apache-2.0
"""Texts for people are formatted in one place."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.text import (
    EXCERPT,
    ellipsize,
    excerpt,
    format_known,
    format_number,
    join_first,
    join_quoted,
    join_words,
    printable_line,
    quote,
)


def test_a_long_text_ends_with_an_ellipsis_inside_of_its_length():
    assert ellipsize("a" * EXCERPT) == "a" * EXCERPT
    assert ellipsize("a" * (EXCERPT + 1)) == "a" * (EXCERPT - 1) + "…"
    assert ellipsize("abcd", 3) == "ab…"


def test_an_excerpt_is_one_line_without_a_space_before_the_ellipsis():
    assert excerpt(" a\n b ", 10) == "a b"
    assert excerpt("ab cdef", 4) == "ab…"


def test_a_quoted_text_is_one_line_and_short():
    assert quote("a\n  b") == "'a b'"
    assert len(quote("a" * 1000)) == EXCERPT + 2


def test_a_printable_line_has_no_control_characters():
    assert printable_line("a\x1b[2Jb\n\tc\u202e") == "a [2Jb c"


@pytest.mark.parametrize(
    ("words", "text"), [((), ""), (("a",), "a"), (("a", "b"), "a and b"), ("abc", "a, b and c")]
)
def test_words_are_joined_as_in_a_sentence(words, text):
    assert join_words(words) == text
    assert join_words(words, "or") == text.replace("and", "or")


def test_of_many_words_the_first_are_shown():
    assert join_first("abcd") == "a, b, c, d"
    assert join_first("abcde") == "a, b, c, d and 1 more"
    assert join_quoted("abcde") == "'a', 'b', 'c', 'd', 'e'"
    assert join_quoted("abcdef") == "'a', 'b', 'c', 'd', 'e', …"


def test_numbers_have_few_digits_and_a_real_minus_sign():
    assert format_number(-1.23456789) == "−1.23457"
    assert format_number(-0.0) == "0"
    assert format_number(1.23456, 3) == "1.23"
    assert format_known(1.23456) == "1.235"
    assert format_known(math.nan) == "–"
