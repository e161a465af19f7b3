# SPDX-License-Identifier: Apache-2.0
"""Renderings of diagnostics: text with excerpts, lines, JSON and GitHub annotations."""

from __future__ import annotations

import json
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from itertools import groupby
from typing import IO

from bt_agents_core.diagnostic import Diagnostic, Severity

MAX_COLLECTED = 500
"""Number of errors after which reading ends, because the file is not a script."""

MAX_SHOWN = 100
"""Maximum number of problems to show per file as text; more do not help."""

MOST_IMPORTS = 2
"""Maximum number of equal import problems to show as text, in all files together."""

_EXCERPT_WIDTH = 96
_SEVERITY_COLOURS = {Severity.ERROR: "31;1", Severity.WARNING: "33;1"}
_BOLD, _DIM, _GREEN = "1", "2", "32"


def wants_colour(stream: IO[str], environment: Mapping[str, str]) -> bool:
    """Return whether to write colours to a stream: only to a terminal.

    A non-empty ``NO_COLOR`` (https://no-color.org) and ``TERM=dumb`` in the environment turn them
    off.
    """
    if environment.get("NO_COLOR") or environment.get("TERM") == "dumb":
        return False
    return stream.isatty()


def as_line(diagnostic: Diagnostic, colour: bool = False) -> str:
    """Return place and message in one line: ``a.yaml:3:5: error[tab]: a tab …``."""
    severity = diagnostic.severity
    place = _styled(visible(str(diagnostic.position)) + ":", _BOLD, colour)
    label = _styled(f"{severity.value}[{diagnostic.code}]:", _SEVERITY_COLOURS[severity], colour)
    return f"{place} {label} {visible(_message(diagnostic))}"


def _message(diagnostic: Diagnostic) -> str:
    """Return the message of a problem, with one inserting place and the number of others."""
    if not diagnostic.inserted:
        return diagnostic.message
    first, *others = diagnostic.inserted
    places = "1 other place" if len(others) == 1 else f"{len(others)} other places"
    more = f" and {places}" if others else ""
    return f"{diagnostic.message} (inserted in {first}{more})"


def as_block(diagnostic: Diagnostic, colour: bool = False) -> str:
    """Return a problem as text: place and message, the line with a caret, the hint.

    Example:
        ::

            a.yaml:3:5: error[unknown-node]: there is no node 'sya'
                3 |   - sya: Hello.
                  |     ^^^
                  hint: did you mean 'say'?
    """
    lines = [as_line(diagnostic, colour)]
    if diagnostic.excerpt.strip():
        lines += _excerpt(diagnostic, colour)
    if diagnostic.hint:
        label = _styled("hint:", _GREEN, colour)
        lines.append(f"{'':6}{label} {visible(diagnostic.hint)}")
    return "\n".join(lines)


def as_text(diagnostics: Iterable[Diagnostic], colour: bool = False) -> str:
    """Return problems as text for a terminal, with limits per file and per import."""
    return "\n".join(_limited(diagnostics, as_block, colour))


def as_lines(diagnostics: Iterable[Diagnostic]) -> tuple[str, ...]:
    """Return problems as one line each, with limits per file and per import."""
    return tuple(_limited(diagnostics, as_line, False))


def as_hinted_line(diagnostic: Diagnostic) -> str:
    """Return a problem like :func:`as_line`, with its hint in parentheses."""
    hint = f" ({visible(diagnostic.hint)})" if diagnostic.hint else ""
    return as_line(diagnostic) + hint


def as_json(diagnostics: Iterable[Diagnostic], about: Mapping[str, object]) -> str:
    """Return problems as one JSON object, with the additional keys in ``about``.

    Returns:
        ``{"version": 1, …, "errors": 1, "warnings": 0, "truncated": false, "problems": [{"code",
        "severity", "file", "line", "column", "end_line", "end_column", "message", "hint"}, …]}``.
        ``truncated`` is true if a file has too many problems to list all. Lines and columns count
        from 1, the end is the character after the last one, a hint may be empty. Later releases
        may add keys; a change in the meaning of a key changes ``version``.
    """
    every = list(diagnostics)
    report = {
        "version": 1,
        **about,
        "errors": count(every, Severity.ERROR),
        "warnings": count(every, Severity.WARNING),
        "truncated": _is_cut(every),
        "problems": [_as_object(diagnostic) for diagnostic in every],
    }
    return json.dumps(report, indent=2)


def as_annotation(diagnostic: Diagnostic) -> str:
    """Return a problem as a workflow command, which GitHub shows at its line.

    Source: https://docs.github.com/actions/reference/workflow-commands-for-github-actions; there
    the end column is the last marked one.
    """
    start = diagnostic.position
    _, last = _marked(diagnostic)
    properties = {
        "file": start.file,
        "line": str(start.line),
        "col": str(start.column),
        "endColumn": str(last),
        "title": f"{diagnostic.severity.value}[{diagnostic.code}]",
    }
    listed = ",".join(f"{key}={_escaped_property(text)}" for key, text in properties.items())
    hint = f"\nhint: {diagnostic.hint}" if diagnostic.hint else ""
    message = _escaped_data(_message(diagnostic) + hint)
    return f"::{diagnostic.severity.value} {listed}::{message}"


def count(diagnostics: Iterable[Diagnostic], severity: Severity) -> int:
    """Return the number of problems with a severity."""
    return sum(diagnostic.severity is severity for diagnostic in diagnostics)


def _is_cut(diagnostics: Iterable[Diagnostic]) -> bool:
    """Return whether a file reached the maximum number of problems of one severity."""
    found = Counter((one.position.file, one.severity) for one in diagnostics)
    return max(found.values(), default=0) >= MAX_COLLECTED


def columns(text: str) -> int:
    """Return the number of terminal columns that a text takes."""
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in text
    )


def visible(text: str) -> str:
    """Return a text without anything that a terminal would interpret instead of showing."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\u00a0" else "\ufffd" for c in text)


def _limited(
    diagnostics: Iterable[Diagnostic], render: Callable[[Diagnostic, bool], str], colour: bool
) -> Iterable[str]:
    folded: dict[str, list[Diagnostic]] = {}
    shown = [one for one in diagnostics if not _is_folded(one, folded)]
    for file, of_file in groupby(shown, key=lambda one: one.position.file):
        every = list(of_file)
        yield from (render(one, colour) for one in every[:MAX_SHOWN])
        if len(every) > MAX_SHOWN:
            yield f"{visible(file)}: … and {len(every) - MAX_SHOWN} or more other problems"
    for cause, alike in folded.items():
        if more := alike[MOST_IMPORTS:]:
            where = visible(more[0].position.file)
            others = f" and {len(more) - 1} more places" if len(more) > 1 else ""
            yield f"… the same in {where}{others}: {cause}"


def _is_folded(diagnostic: Diagnostic, folded: dict[str, list[Diagnostic]]) -> bool:
    """Return whether enough earlier problems report the same about an import.

    A broken import is never the cause, but follows from a problem in another file.
    """
    match diagnostic.code:
        case "broken-import":
            cause = "an import has errors itself"
        case "bad-import":
            cause = visible(diagnostic.message)
        case _:
            return False
    alike = folded.setdefault(cause, [])
    alike.append(diagnostic)
    return len(alike) > MOST_IMPORTS


def _excerpt(diagnostic: Diagnostic, colour: bool) -> list[str]:
    first, last = _marked(diagnostic)
    line = visible(diagnostic.excerpt.replace("\t", " "))
    column, width = first - 1, last - first + 1
    cut = max(0, column - _EXCERPT_WIDTH // 2) if len(line) > _EXCERPT_WIDTH else 0
    shown = line[cut : cut + _EXCERPT_WIDTH]
    before = "…" if cut else ""
    after = "…" if cut + _EXCERPT_WIDTH < len(line) else ""
    pad = " " * columns(before + shown[: column - cut])
    carets = "^" * max(1, columns(shown[column - cut : column - cut + width]))
    number = _styled(f"{diagnostic.position.line:>5} |", _DIM, colour)
    margin = _styled(f"{'':5} |", _DIM, colour)
    marks = _styled(carets, _SEVERITY_COLOURS[diagnostic.severity], colour)
    return [f"{number} {before}{shown}{after}", f"{margin} {pad}{marks}"]


def _marked(diagnostic: Diagnostic) -> tuple[int, int]:
    """Return the first and last marked column of the first line, from 1."""
    first, end = diagnostic.position, diagnostic.end
    if end is None:
        return first.column, first.column
    length = len(diagnostic.excerpt)
    last = end.column - 1 if end.line == first.line else length
    return first.column, max(first.column, min(last, length) if length else last)


def _as_object(diagnostic: Diagnostic) -> dict[str, object]:
    start, end = diagnostic.position, diagnostic.end
    return {
        "code": diagnostic.code,
        "severity": diagnostic.severity.value,
        "file": start.file,
        "line": start.line,
        "column": start.column,
        "end_line": end.line if end is not None else start.line,
        "end_column": end.column if end is not None else start.column + 1,
        "message": _message(diagnostic),
        "hint": diagnostic.hint,
    }


def _escaped_data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _escaped_property(text: str) -> str:
    return _escaped_data(text).replace(":", "%3A").replace(",", "%2C")


def _styled(text: str, style: str, colour: bool) -> str:
    return f"\x1b[{style}m{text}\x1b[0m" if colour else text
