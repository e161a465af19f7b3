# SPDX-License-Identifier: Apache-2.0
"""Display of a file's problems."""

from __future__ import annotations

import pytest

from bt_agents_core.diagnostic import Position
from bt_agents_core.errors import ReadError
from bt_agents_language.diagnostics.collection import Diagnostics, did_you_mean
from bt_agents_language.diagnostics.renderers import MAX_COLLECTED, MAX_SHOWN
from bt_agents_language.yaml.source import Source


def at(line: int, column: int) -> Position:
    return Position(file="a.yaml", line=line, column=column)


def test_problem_is_shown_with_line_caret_and_hint():
    problems = Diagnostics(Source("a.yaml", "tree:\n  sya: Hello.\n"))
    problems.add(
        "unknown-node", at(2, 3), "there is no node 'sya'", "did you mean 'say'?", at(2, 6)
    )
    assert problems.error().report == (
        "a.yaml:2:3: error[unknown-node]: there is no node 'sya'\n"
        "    2 |   sya: Hello.\n"
        "      |   ^^^\n"
        "      hint: did you mean 'say'?"
    )


def test_problems_are_sorted_by_position():
    problems = Diagnostics(None)
    problems.add("syntax", at(9, 1), "c")
    problems.add("syntax", at(2, 7), "b")
    problems.add("syntax", at(2, 3), "a")
    assert problems.error().lines == (
        "a.yaml:2:3: error[syntax]: a",
        "a.yaml:2:7: error[syntax]: b",
        "a.yaml:9:1: error[syntax]: c",
    )


def test_same_problem_at_same_position_counts_once():
    problems = Diagnostics(None)
    problems.add("syntax", at(1, 1), "a")
    problems.add("syntax", at(1, 1), "a")
    assert len(problems) == 1


def test_a_long_line_is_cut_around_the_caret():
    text = "x" * 500 + "HERE" + "y" * 500
    problems = Diagnostics(Source("a.yaml", text))
    problems.add("syntax", at(1, 501), "m", end=at(1, 505))
    _, line, caret = problems.error().report.splitlines()
    assert len(line) < 110
    assert line[caret.index("^") : caret.rindex("^") + 1] == "HERE"


@pytest.mark.parametrize("before", ["日本語 ", "Grüß ", "e\u0301 "])
def test_caret_is_aligned_in_any_script(before):
    problems = Diagnostics(Source("a.yaml", f"{before}X"))
    problems.add("syntax", at(1, len(before) + 1), "m")
    _, _, caret = problems.error().report.splitlines()
    width = {"日本語 ": 7, "Grüß ": 5, "e\u0301 ": 2}[before]
    assert caret.index("^") == len("    1 | ") + width


def test_multiline_span_underlines_rest_of_first_line():
    problems = Diagnostics(Source("a.yaml", "abc def\nghi"))
    problems.add("syntax", at(1, 5), "m", end=at(2, 2))
    assert problems.error().report.splitlines()[2] == "      |     ^^^"


def test_reading_stops_after_too_many_errors():
    problems = Diagnostics(None)

    def add_all() -> None:
        for line in range(MAX_COLLECTED + 1):
            problems.add("syntax", at(line, 1), "m")

    with pytest.raises(ReadError) as error:
        add_all()
    assert len(error.value.lines) == MAX_SHOWN + 1
    assert "400 or more other problems" in error.value.lines[-1]


@pytest.mark.parametrize(
    ("word", "known", "hint"),
    [
        ("sya", ["wait", "say"], "did you mean 'say'?"),
        ("Say", ["wait", "say"], "did you mean 'say'?"),
        ("age", ["live.mood", "scene.age"], "did you mean 'scene.age'?"),
        ("xyz", ["a", "b"], "possible here: a, b"),
        ("xyz", [], ""),
        ("аge", ["age"], "did you mean 'age'? ('а' is CYRILLIC SMALL LETTER A)"),  # noqa: RUF001
        ("a" * 100_000, ["b"], "possible here: b"),
    ],
)
def test_a_hint_names_the_most_similar_word(word, known, hint):
    assert did_you_mean(word, known) == hint
