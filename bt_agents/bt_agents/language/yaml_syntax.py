# SPDX-License-Identifier: Apache-2.0
"""What a YAML syntax error most likely means, in words that say how to mend it."""

from __future__ import annotations

import re
from collections.abc import Callable

import yaml

from bt_agents.language.diagnostics import Diagnostics
from bt_agents.language.source import Source

_INDENTED_TAB = re.compile(r" *\t")
_FIT = "two nodes in one item: indent the block, or start a new '-' item"
_QUOTE_INSIDE = "inside { … } and [ … ], quote texts with ':', '?', ',' or brackets in them"

Explanation = tuple[int, str, str]
"""Index in the text, message, hint."""


def report_syntax(source: Source, problems: Diagnostics, error: yaml.MarkedYAMLError) -> None:
    """Add what a parser error means."""
    mark = error.problem_mark or error.context_mark
    index = mark.index if mark is not None else 0
    position = source.position(index)
    tab = _INDENTED_TAB.match(source.line(position.line))
    if tab is not None and position.column <= tab.end():
        at = index - position.column + tab.end()
        problems.add(
            "tab",
            source.position(at),
            "a tab indents this line",
            "use spaces (most editors can turn tabs into spaces)",
        )
        return
    problem = error.problem or ""
    for part, explain in _EXPLANATIONS.items():
        if part in problem:
            at, message, hint = explain(source, error, index)
            problems.add("syntax", source.position(at), message, hint)
            return
    problems.add("syntax", position, problem or "this is not valid YAML", "look at the line above")


def _second_colon(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    line = source.line(source.position(index).line)
    column = source.position(index).column
    before = line[: column - 1]
    if ":" not in before:
        start = index - len(before.lstrip())
        return (
            start,
            "this line is indented deeper than the one it follows",
            "write it below the first letter of the line above",
        )
    return index, "a second ':' stands in this line", "quote a text with ': ' in it: \"…: …\""


def _dash(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    return index, "a '-' item starts in the middle of a line", "start it on a line of its own"


def _no_colon(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    at = error.context_mark.index if error.context_mark is not None else index
    return (
        at,
        "this line is neither 'key: value' nor a '-' item",
        "put a ': ' behind the key, or indent the line if it belongs to the text above",
    )


def _flow(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    opened = error.context_mark.index if error.context_mark is not None else index
    before = source.text[max(0, index - 2) : index]
    if source.text[index : index + 1] == "{" and before.endswith("$"):
        return (
            index - 1,
            "${…} stands without quotes inside { … } or [ … ]",
            'quote it there: "${name}"',
        )
    if index >= len(source.text.rstrip()):
        bracket = source.text[opened : opened + 1] or "{"
        return opened, f"this '{bracket}' is not closed", "close it at the end of the value"
    return (
        index,
        "a ',' or the closing bracket is expected here",
        _QUOTE_INSIDE,
    )


def _misfit(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    position = source.position(index)
    line = source.line(position.line)
    before = line[: position.column - 1]
    if before.strip(" -"):
        return (
            index,
            "something stands behind the end of a value",
            "put quotes around the whole text, or start a new line",
        )
    if _starts_item(line):
        return (
            index,
            "this '-' item does not line up with the block above",
            "indent it like the others",
        )
    return index, "this line fits no block above it", _FIT


def _starts_item(line: str) -> bool:
    return line.lstrip().startswith("- ")


def _unclosed(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    at = error.context_mark.index if error.context_mark is not None else index
    return at, "this quotation mark is not closed", "add one at the end of the text"


def _bad_start(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    character = source.text[index : index + 1]
    if character == "\t":
        return index, "a tab stands here", "use spaces"
    return index, f"a text cannot start with '{character}'", 'quote it: "…"'


def _escape(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    backslash = source.text.find("\\", index)
    while backslash >= 0 and source.text[backslash + 1 : backslash + 2] in _KNOWN_ESCAPES:
        backslash = source.text.find("\\", backslash + 2)
    at = backslash if backslash >= 0 else index
    return (
        at,
        f"'{source.text[at : at + 2]}' means nothing inside \"…\"",
        "write the backslash twice, or use '…'",
    )


_KNOWN_ESCAPES = set('0abt\tnvfre "/\\N_LPxuU\n\r')


def _no_content(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    found = source.text[index : index + 1]
    return (
        index,
        f"a value is expected here, found '{found}'",
        _QUOTE_INSIDE if found not in ("]", "}", ",") else "remove it, or quote the text",
    )


def _after_the_end(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    return (
        index,
        "something stands behind the end of the file's one value",
        "put quotes around a whole text; write everything below keys of the file",
    )


def _directive(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    at = error.context_mark.index if error.context_mark is not None else index
    return at, "a line cannot start with '%'", "quote the text, or indent it"


def _indentation_marks(source: Source, error: yaml.MarkedYAMLError, index: int) -> Explanation:
    return index, "a text block ('|' or '>') starts wrongly", "write only '|' or '>' in that line"


_EXPLANATIONS: dict[str, Callable[[Source, yaml.MarkedYAMLError, int], Explanation]] = {
    "mapping values are not allowed": _second_colon,
    "block sequence entries are not allowed": _dash,
    "could not find expected ':'": _no_colon,
    "did not find expected ',' or": _flow,
    "did not find expected '-' indicator": _misfit,
    "did not find expected key": _misfit,
    "unexpected end of stream": _unclosed,
    "cannot start any token": _bad_start,
    "unknown escape character": _escape,
    "did not find expected node content": _no_content,
    "did not find expected comment or line break": _indentation_marks,
    "did not find expected <document start>": _after_the_end,
    "directive": _directive,
}
"""Part of the parser's message → what it means."""
