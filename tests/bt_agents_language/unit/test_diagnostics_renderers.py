# SPDX-License-Identifier: Apache-2.0
"""Problems as coloured text, as JSON and as annotations on GitHub."""

from __future__ import annotations

import io
import json
import re

import pytest

from bt_agents_core.diagnostic import Diagnostic, Position, Severity
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.diagnostics.renderers import (
    as_annotation,
    as_block,
    as_json,
    as_line,
    as_text,
    count,
    wants_colour,
)


def at(line: int, column: int, file: str = "trees/agents/a.yaml") -> Position:
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
        (Terminal(), {"NO_COLOR": "false"}, False),
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


def test_warning_is_labelled_as_warning():
    assert as_line(WARNING) == (
        "trees/agents/a.yaml:9:1: warning[endless-speech]: there is no node 'sya'"
    )


@pytest.mark.parametrize("strange", ["\x1b[31m", "\x07", "\n", "\u202e", "\r", "\ud83d"])
def test_terminal_control_characters_are_never_printed(strange):
    text = as_block(
        problem(
            message=f"a{strange}b",
            hint=f"c{strange}d",
            excerpt=f"e{strange}f",
            position=at(1, 1, f"g{strange}h.yaml"),
        )
    )
    assert strange not in text.replace("\n", "", 3) if strange == "\n" else strange not in text
    assert text.count("\n") == 3
    text.encode()


def test_json_has_a_stable_shape():
    report = json.loads(as_json([problem(), WARNING], {"agents": ("guide",)}))
    assert report == {
        "version": 1,
        "agents": ["guide"],
        "errors": 1,
        "warnings": 1,
        "truncated": False,
        "problems": [
            {
                "code": "unknown-node",
                "severity": "error",
                "file": "trees/agents/a.yaml",
                "line": 3,
                "column": 5,
                "end_line": 3,
                "end_column": 8,
                "message": "there is no node 'sya'",
                "hint": "did you mean 'say'?",
            },
            {
                "code": "endless-speech",
                "severity": "warning",
                "file": "trees/agents/a.yaml",
                "line": 9,
                "column": 1,
                "end_line": 9,
                "end_column": 2,
                "message": "there is no node 'sya'",
                "hint": "",
            },
        ],
    }


def test_json_accepts_any_file_name():
    as_json([problem(position=at(1, 1, "\udcff.yaml"))], {}).encode()


def test_annotation_marks_first_to_last_column():
    assert as_annotation(problem()) == (
        "::error file=trees/agents/a.yaml,line=3,col=5,endColumn=7,title=error[unknown-node]"
        "::there is no node 'sya'%0Ahint: did you mean 'say'?"
    )
    assert as_annotation(WARNING) == (
        "::warning file=trees/agents/a.yaml,line=9,col=1,endColumn=1,"
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


def test_problems_are_counted_by_severity():
    assert count([problem(), WARNING, WARNING], Severity.ERROR) == 1
    assert count([problem(), WARNING, WARNING], Severity.WARNING) == 2


def test_text_output_limits_problems_per_file():
    many = [problem(position=at(line, 1)) for line in range(1, 151)]
    other = problem(position=at(1, 1, "b.yaml"))
    text = as_text([*many, other])
    assert "trees/agents/a.yaml: … and 50 or more other problems" in text
    assert "b.yaml:1:1" in text
    assert len(json.loads(as_json([*many, other], {}))["problems"]) == 151


@pytest.mark.parametrize(("number", "cut"), [(499, False), (500, True)])
def test_json_flags_truncated_problem_list(number, cut):
    many = [problem(position=at(line, 1)) for line in range(1, number + 1)]
    assert (
        json.loads(as_json([*many, problem(position=at(1, 1, "b.yaml"))], {}))["truncated"] is cut
    )


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
