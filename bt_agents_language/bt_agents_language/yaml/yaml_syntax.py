# SPDX-License-Identifier: Apache-2.0
"""Messages and hints for YAML syntax errors."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import yaml

from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.precheck import UNDECIDED
from bt_agents_language.yaml.source import Edit, Source, indentation, line_at, line_start
from bt_agents_language.yaml.syntax_hints import (
    QUOTE_INSIDE,
    SyntaxHint,
    after_value,
    comment_hint,
    in_brackets,
    key_hint,
    line_hint,
)

_NEXT_LINE = re.compile(r"[^\r\n]+")
_INDENTED_TAB = re.compile(r" *\t")
_WRONG_QUOTES = re.compile("(?<=[:,\\-\\[{(] )[\u201c\u201d\u201e\u2018\u2019\u00ab]")
_CONFLICT = ("<<<<<<<", "=======", ">>>>>>>")

Explain = Callable[[Source, int, int], SyntaxHint]
"""Function of the source, the index where the parser stopped, and where that part began."""


def report_syntax(
    source: Source, problems: Diagnostics, error: yaml.MarkedYAMLError
) -> SyntaxHint:
    """Add and return the meaning of a parser error."""
    found = _hint_for(source, error)
    end = source.position(found.index + found.width)
    problems.add(found.code, source.position(found.index), found.message, found.hint, end)
    return found


def _hint_for(source: Source, error: yaml.MarkedYAMLError) -> SyntaxHint:
    stopped = error.problem_mark or error.context_mark
    index = stopped.index if stopped is not None else 0
    begun = error.context_mark.index if error.context_mark is not None else index
    position = source.position(index)
    start = line_start(source, index)
    tab = _INDENTED_TAB.match(line_at(source, start))
    if tab is not None and position.column <= tab.end():
        return SyntaxHint(
            code="tab",
            index=start + tab.end() - 1,
            message="a tab indents this line",
            hint="use spaces (most editors can turn tabs into spaces)",
        )
    above = line_start(source, len(source.text[:start].rstrip()))
    for at in (start, above):
        comment = comment_hint(line_at(source, at), at)
        if comment is not None:
            return comment
    text = f"{error.context or ''}: {error.problem or ''}"
    for pattern, explain in _EXPLANATIONS.items():
        if re.search(pattern, text):
            return explain(source, index, begun)
    message = error.problem or "this is not valid YAML"
    return SyntaxHint(index=index, message=message, hint="look at the line above")


def _second_colon(source: Source, index: int, begun: int) -> SyntaxHint:
    start = line_start(source, index)
    line = line_at(source, start)
    before = source.text[start:index]
    if re.search(r":(\s|$)", before):
        wrong = _WRONG_QUOTES.search(before)
        if wrong is not None:
            return SyntaxHint(
                index=start + wrong.start(),
                message=f"'{wrong[0]}' is not a quotation mark in this language",
                hint='use straight ones: "…"',
            )
        quoted = _quoted_value(source, start, line)
        return SyntaxHint(
            index=index,
            message="this line has a second ':'",
            hint="quote a text with ': ' in it: \"…: …\"",
            fix=quoted,
        )
    above = source.text[:start].rstrip()
    if above:
        # A text that seems to span two lines is a key above, whose colon does not count as one.
        found = _sure(source, line_start(source, len(above)), key_hint)
        if found is not None:
            return found
    own = key_hint(before, start)
    if own is not None and ":" in before:
        return own
    return SyntaxHint(
        index=start + len(before) - len(before.lstrip()),
        message="this line is indented deeper than the one it follows",
        hint="write it below the first letter of the line above",
    )


def _quoted_value(source: Source, start: int, line: str) -> Edit | None:
    """Return the edit that quotes everything after the first colon of a line."""
    match = re.match(r"\s*(?:- +)*[\w-]+: +(?=[^\s'\"{\[|>&*!#])", line)
    text = line[match.end() :].rstrip() if match is not None else ""
    mark = next((one for one in ('"', "'") if one not in text and "\\" not in text), "")
    if match is None or not mark or " #" in text:
        return None
    at = start + match.end()
    return Edit(start=at, stop=at + len(text), text=f"{mark}{text}{mark}")


def _no_colon(source: Source, index: int, begun: int) -> SyntaxHint:
    if source.text.startswith(_CONFLICT, begun):
        message, hint = UNDECIDED
        return SyntaxHint(index=begun, width=len(_CONFLICT[0]), message=message, hint=hint)
    found = _sure(source, line_start(source, begun), line_hint)
    return found or SyntaxHint(
        index=begun,
        message="this line is neither 'key: value' nor a '-' item",
        hint="put a ': ' after the key, or indent the line if it belongs to the text above",
    )


def _misfit(source: Source, index: int, begun: int) -> SyntaxHint:
    start = line_start(source, index)
    line = line_at(source, start)
    before = source.text[start:index]
    if before.strip(" -"):
        return after_value(source, index)
    if line.lstrip().startswith("- "):
        return SyntaxHint(
            index=index,
            message="this '-' item does not line up with the block above",
            hint="indent it like the others",
        )
    return SyntaxHint(
        index=index,
        message="this line fits no block above it",
        hint="indent it like the key after the '-' above, or start a new '-' item",
    )


def _no_item(source: Source, index: int, begun: int) -> SyntaxHint:
    start = line_start(source, index)
    line = line_at(source, start)
    found = line_hint(line, start)
    if found is not None and found.is_item:
        return found
    if source.position(index).column == source.position(
        begun
    ).column and not line.lstrip().startswith("-"):
        return SyntaxHint(
            index=index,
            width=len(line.strip().partition(":")[0]) or 1,
            message="this line is in a list of '-' items, but does not start with '- '",
            hint="put '- ' in front of it, or indent it if it belongs to the item above",
        )
    return _misfit(source, index, begun)


def _bad_start(source: Source, index: int, begun: int) -> SyntaxHint:
    if source.text.startswith("\t", index):
        return SyntaxHint(index=index, message="a tab stands here", hint="use spaces")
    return _unquoted(source, index)


def _mark_at_start(source: Source, index: int, begun: int) -> SyntaxHint:
    return _unquoted(source, begun)


def _question(source: Source, index: int, begun: int) -> SyntaxHint:
    return _unquoted(source, index, after=" ")


def _unquoted(source: Source, index: int, after: str = "") -> SyntaxHint:
    found = source.text[index : index + 1] + after
    start = line_start(source, index)
    return SyntaxHint(
        index=index,
        message=f"a text cannot start with {quote(found)}",
        hint='quote it: "…"',
        fix=_quoted_rest(source, start, index),
    )


def _quoted_rest(source: Source, start: int, index: int) -> Edit | None:
    text = line_at(source, start)[index - start :].rstrip()
    alone = re.fullmatch(r"\s*(?:- +)*(?:[\w-]+: +)?", source.text[start:index]) is not None
    if not alone or " #" in text or '"' in text or "\\" in text:
        return None
    return Edit(start=index, stop=index + len(text), text=f'"{text}"')


def _escape(source: Source, index: int, begun: int) -> SyntaxHint:
    backslash = source.text.find("\\", index)
    while backslash >= 0 and source.text[backslash + 1 : backslash + 2] in _KNOWN_ESCAPES:
        backslash = source.text.find("\\", backslash + 2)
    at = backslash if backslash >= 0 else index
    return SyntaxHint(
        index=at,
        width=2,
        message=f"'{source.text[at : at + 2]}' means nothing inside \"…\"",
        hint="write the backslash twice, or use '…'",
        fix=Edit(start=at, stop=at, text="\\") if backslash >= 0 else None,
    )


_KNOWN_ESCAPES = set('0abt\tnvfre "/\\N_LPxuU\n\r')


def _no_content(source: Source, index: int, begun: int) -> SyntaxHint:
    found = source.text[index : index + 1]
    return SyntaxHint(
        index=index,
        message=f"a value is expected here, found '{found}'",
        hint=QUOTE_INSIDE if found not in ("]", "}", ",") else "remove it, or quote the text",
    )


def _always(message: str, hint: str, *, where_begun: bool = False) -> Explain:
    def explain(source: Source, index: int, begun: int) -> SyntaxHint:
        return SyntaxHint(index=begun if where_begun else index, message=message, hint=hint)

    return explain


_EXPLANATIONS: dict[str, Explain] = {
    "mapping values are not allowed": _second_colon,
    "block sequence entries are not allowed": _always(
        "a '-' item starts in the middle of a line",
        "start it on a line of its own, or quote a text that starts with '- '",
    ),
    "mapping keys are not allowed": _question,
    "could not find expected ':'": _no_colon,
    "did not find expected ',' or": in_brackets,
    "did not find expected '-' indicator": _no_item,
    "did not find expected key": _misfit,
    "unexpected (end of stream|document indicator)": _always(
        "this quotation mark is not closed", "add one at the end of the text", where_begun=True
    ),
    "cannot start any token|undefined tag handle": _bad_start,
    "while scanning an (alias|anchor)|while (scanning|parsing) a tag": _mark_at_start,
    "unknown escape character": _escape,
    "did not find expected node content": _no_content,
    "did not find expected comment or line break|indentation indicator": _always(
        "a text block ('|' or '>') starts wrongly", "write only '|' or '>' in that line"
    ),
    "did not find expected <document start>": _always(
        "something follows the end of the file's one value",
        "remove a line '...' above; put quotes around a whole text",
    ),
    "incompatible YAML document|directive": _always(
        "a line cannot start with '%'", "remove the line, or quote the text", where_begun=True
    ),
}
"""Pattern of the parser's message → its meaning."""


def _sure(
    source: Source, start: int, find: Callable[[str, int], SyntaxHint | None]
) -> SyntaxHint | None:
    """Return a hint for a line, without its edit where a lonely word may be part of a text."""
    line = line_at(source, start)
    found = find(line, start)
    if found is None or found.fix is None:
        return found
    added = found.fix.text == ":" and found.fix.start == found.fix.stop
    if not added:
        return found
    below = _NEXT_LINE.search(source.text, start + len(line))
    next_line = below[0] if below is not None else ""
    is_key = indentation(next_line) > indentation(line) or next_line.lstrip().startswith("- ")
    return found if is_key else replace(found, fix=None)
