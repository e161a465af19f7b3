# SPDX-License-Identifier: Apache-2.0
"""Syntax hints for brackets and quotation marks that are open or closed at the wrong place."""

from __future__ import annotations

from bt_agents_core.text import quote
from bt_agents_language.yaml.line_hints import SyntaxHint
from bt_agents_language.yaml.source import (
    Edit,
    Source,
    end_above,
    indentation,
    line_at,
    line_start,
)

QUOTE_INSIDE = "inside { … } and [ … ], quote texts with ':', '?', ',' or brackets in them"
_COMMENT = "a '#' behind a space starts a comment: put quotes around the text"
_CLOSING = {"{": "}", "[": "]"}
_DELIMITERS = " \t\r\n,;:{}[]"


def in_brackets(source: Source, index: int, begun: int) -> SyntaxHint:
    """Return what is wrong between an open bracket and where the parser stopped."""
    text = source.text
    found = text[index : index + 1]
    if found == "{" and text[max(0, index - 2) : index].endswith("$"):
        return SyntaxHint(
            index=index - 1,
            message="${…} stands without quotes inside { … } or [ … ]",
            hint='quote it there: "${name}"',
        )
    bracket = text[begun : begun + 1] or "{"
    closing = _CLOSING.get(bracket, "}")
    word = _word_before(text, index) if found == ":" else ""
    at = index - len(word)
    at_end = index >= len(text.rstrip())
    if at_end or (word and _no_deeper(source, at, begun)):
        end = end_above(source, at) if word else len(text.rstrip())
        return SyntaxHint(
            index=begun,
            message=f"this '{bracket}' is not closed",
            hint=_COMMENT
            if " #" in line_at(source, line_start(source, begun))
            else f"close it with '{closing}' at the end of the value",
            fix=_inserted(text, begun, end, closing) if not at_end else None,
        )
    if word:
        end = len(text[:at].rstrip())
        return SyntaxHint(
            index=at,
            width=len(word),
            message=f"a ',' is expected before {quote(word)}",
            hint="put a ',' between two values, and quote a text with ': ' in it",
            fix=_inserted(text, begun, end, ",") if _is_key(text, at, word) else None,
        )
    if found in _CLOSING.values():
        return SyntaxHint(
            index=index,
            message=f"the '{bracket}' of column {source.position(begun).column} is closed by "
            f"'{found}'",
            hint=f"close it with '{closing}'",
            fix=Edit(start=index, stop=index + 1, text=closing),
        )
    return SyntaxHint(
        index=index, message="a ',' or the closing bracket is expected here", hint=QUOTE_INSIDE
    )


def _word_before(text: str, index: int) -> str:
    at = index
    while at and text[at - 1] not in _DELIMITERS:
        at -= 1
    return text[at:index]


def _is_key(text: str, at: int, word: str) -> bool:
    """Return whether a word with a colon behind it looks like the next key, not like a text."""
    before = text[:at].rstrip()
    return "\n" in text[len(before) : at] and word.strip("'\"").isidentifier()


def _inserted(text: str, begun: int, at: int, closing: str) -> Edit | None:
    return None if "#" in text[begun:at] else Edit(start=at, stop=at, text=closing)


def _no_deeper(source: Source, index: int, begun: int) -> bool:
    """Return whether a place stands no deeper than the line in which something began."""
    line = line_at(source, line_start(source, begun))
    return source.position(index).column <= indentation(line) + 1


def behind_value(source: Source, index: int) -> SyntaxHint:
    """Return what is wrong where something stands behind the end of a value."""
    found = source.text[index : index + 1]
    if found in _CLOSING.values():
        return SyntaxHint(
            index=index,
            message=f"there is no open bracket that this '{found}' could close",
            hint="remove it",
            fix=Edit(start=index, stop=index + 1, text=" "),
        )
    message = "something stands behind the end of a value"
    mark = source.text[index - 1 : index]
    opened = source.text.rfind(mark, 0, index - 1) if mark in ("'", '"') else index
    line = source.position(index).line
    if mark == "'":
        hint = 'put a text with an apostrophe in double quotes: "…"'
    elif mark != '"':
        hint = "put quotes around the whole text, or start a new line"
    elif source.position(opened).line < line:
        index = opened
        message, hint = f"this quotation mark is closed only in line {line}", "close it before"
    else:
        hint = 'write the quotation marks inside of a text as \\"'
    return SyntaxHint(index=index, message=message, hint=hint)
