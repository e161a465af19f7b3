# SPDX-License-Identifier: Apache-2.0
"""Problems of a file, and their display as text, as JSON and as annotations on GitHub."""

from __future__ import annotations

import io
import json
import re

import pytest

from agent_texts import refusal
from bt_agents_core.diagnostic import Diagnostic, Position, Severity
from bt_agents_language.diagnostics.collection import Diagnostics, did_you_mean
from bt_agents_language.diagnostics.renderers import (
    MAX_COLLECTED,
    MAX_SHOWN,
    as_annotation,
    as_block,
    as_json,
    as_text,
    wants_colour,
)
from bt_agents_language.yaml.source import Source


def at(line: int, column: int, file: str = "a.yaml") -> Position:
    return Position(file=file, line=line, column=column)


def problem(**changes: object) -> Diagnostic:
    fields: dict[str, object] = {
        "code": "unknown-node",
        "position": at(3, 5),
        "end": at(3, 8),
        "message": "there is no node 'sya'",
        "hint": "did you mean 'say'?",
        "excerpt": "  - sya: Hello.",
    }
    return Diagnostic(**{**fields, **changes})


WARNING = problem(
    code="endless-speech",
    position=at(9, 1),
    end=None,
    hint="",
    excerpt="say: A.",
    severity=Severity.WARNING,
)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stream", "environment", "wanted"),
    [
        (Terminal(), {}, True),
        (Terminal(), {"NO_COLOR": ""}, True),
        (Terminal(), {"NO_COLOR": "1"}, False),
        (Terminal(), {"TERM": "dumb"}, False),
        (io.StringIO(), {}, False),
    ],
)
def test_only_terminals_without_opt_out_get_colours(stream, environment, wanted):
    assert wants_colour(stream, environment) is wanted


def test_colours_do_not_change_the_text():
    dressed = as_text([problem(), WARNING], colour=True)
    assert re.sub(r"\x1b\[[0-9;]*m", "", dressed) == as_text([problem(), WARNING])
    assert "\x1b[31;1merror[unknown-node]:\x1b[0m" in dressed
    assert "\x1b[33;1mwarning[endless-speech]:\x1b[0m" in dressed


@pytest.mark.parametrize("strange", ["\x1b[31m", "\x07", "\n", "\u202e", "\r", "\ud83d"])
def test_terminal_control_characters_are_never_printed(strange):
    texts = dict.fromkeys(("message", "hint", "excerpt"), f"a{strange}b")
    text = as_block(problem(**texts, position=at(1, 1, f"g{strange}h.yaml")))
    assert strange not in text.replace("\n", "", 3) if strange == "\n" else strange not in text
    assert text.count("\n") == 3
    text.encode()


def test_json_has_a_stable_shape():
    error = {
        "code": "unknown-node",
        "severity": "error",
        "file": "a.yaml",
        "line": 3,
        "column": 5,
        "end_line": 3,
        "end_column": 8,
        "message": "there is no node 'sya'",
        "hint": "did you mean 'say'?",
    }
    place = {"line": 9, "column": 1, "end_line": 9, "end_column": 2}
    warning = {**error, **place, "code": "endless-speech", "severity": "warning", "hint": ""}
    counts = {"errors": 1, "warnings": 1, "truncated": False}
    report = json.loads(as_json([problem(), WARNING], {"agents": ("guide",)}))
    assert report == {"version": 1, "agents": ["guide"], **counts, "problems": [error, warning]}


def test_json_accepts_any_file_name():
    as_json([problem(position=at(1, 1, "\udcff.yaml"))], {}).encode()


def test_annotation_marks_first_to_last_column():
    assert as_annotation(problem()) == (
        "::error file=a.yaml,line=3,col=5,endColumn=7,title=error[unknown-node]"
        "::there is no node 'sya'%0Ahint: did you mean 'say'?"
    )
    assert as_annotation(WARNING) == (
        "::warning file=a.yaml,line=9,col=1,endColumn=1,"
        "title=warning[endless-speech]::there is no node 'sya'"
    )


def test_multiline_annotation_marks_rest_of_first_line():
    assert "col=5,endColumn=15," in as_annotation(problem(end=at(5, 2)))


def test_file_text_cannot_escape_annotation():
    hostile = problem(
        message="50 % done\n::error::gotcha\r", position=at(1, 1, "a,line=7::b:\n.yaml")
    )
    text = as_annotation(hostile)
    assert "\n" not in text
    assert "\r" not in text
    assert text.startswith("::error file=a%2Cline=7%3A%3Ab%3A%0A.yaml,line=1,")
    assert "::50 %25 done%0A::error::gotcha%0D%0Ahint" in text


def test_text_output_limits_problems_per_file():
    many = [problem(position=at(line, 1)) for line in range(1, 151)]
    other = problem(position=at(1, 1, "b.yaml"))
    text = as_text([*many, other])
    assert "a.yaml: … and 50 or more other problems" in text
    assert "b.yaml:1:1" in text
    assert len(json.loads(as_json([*many, other], {}))["problems"]) == 151


@pytest.mark.parametrize(("number", "cut"), [(499, False), (500, True)])
def test_json_flags_truncated_problem_list(number, cut):
    many = [problem(position=at(line, 1)) for line in range(1, number + 1)]
    report = as_json([*many, problem(position=at(1, 1, "b.yaml"))], {})
    assert json.loads(report)["truncated"] is cut


def test_warnings_do_not_make_a_file_unreadable():
    problems = Diagnostics(None)
    problems.add("endless-speech", at(9, 1), "m", severity=Severity.WARNING)
    problems.raise_if_any()
    assert len(problems) == 0
    assert not problems
    assert [warning.code for warning in problems.warnings] == ["endless-speech"]
    problems.add("unknown-node", at(3, 5), "m")
    assert [error.code for error in problems.error().diagnostics] == ["unknown-node"]


def test_excess_warnings_are_cut_without_stopping_the_reader():
    problems = Diagnostics(None)
    for line in range(2000):
        problems.add("endless-speech", at(line, 1), "m", severity=Severity.WARNING)
    assert len(problems.warnings) == 500


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


def test_different_problems_are_sorted_by_position():
    problems = Diagnostics(None)
    for line, column, message in ((9, 1, "c"), (2, 7, "b"), (2, 3, "a"), (2, 3, "a")):
        problems.add("syntax", at(line, column), message)
    assert problems.error().lines == (
        "a.yaml:2:3: error[syntax]: a",
        "a.yaml:2:7: error[syntax]: b",
        "a.yaml:9:1: error[syntax]: c",
    )


def test_a_long_line_is_cut_around_the_caret():
    text = "x" * 500 + "HERE" + "y" * 500
    problems = Diagnostics(Source("a.yaml", text))
    problems.add("syntax", at(1, 501), "m", end=at(1, 505))
    _, line, caret = problems.error().report.splitlines()
    assert len(line) < 110
    assert line[caret.index("^") : caret.rindex("^") + 1] == "HERE"


@pytest.mark.parametrize(("before", "width"), [("日本語 ", 7), ("Grüß ", 5), ("e\u0301 ", 2)])
def test_caret_is_aligned_in_any_script(before, width):
    problems = Diagnostics(Source("a.yaml", f"{before}X"))
    problems.add("syntax", at(1, len(before) + 1), "m")
    _, _, caret = problems.error().report.splitlines()
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

    lines = refusal(add_all).lines
    assert len(lines) == MAX_SHOWN + 1
    assert "400 or more other problems" in lines[-1]


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
