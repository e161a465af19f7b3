# SPDX-License-Identifier: Apache-2.0
"""Syntax hints for lines meant as 'key: value' or '-' items, brackets and quotation marks."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from bt_agents_core.text import ellipsize, quote
from bt_agents_language.expression.quantities import COMMENT
from bt_agents_language.yaml.source import Edit, Source, indentation, line_at, line_start

_LEAD = r"^(?P<lead>\s*(?:-\s+)*)"
_KEY = r"(?P<key>[^\W\d][\w-]*)"
_NO_SPACE = re.compile(rf"{_LEAD}{_KEY}:(?=[^\s/])")
_ONE_WORD = re.compile(rf"{_LEAD}{_KEY}\s*(?:#.*)?$")
_EQUALS = re.compile(rf"{_LEAD}{_KEY}\s*=(?=\s)")
_WIDE_COLON = re.compile(rf"{_LEAD}{_KEY}\s*(?P<colon>[：︰﹕∶ː])")  # noqa: RUF001 - meant
_DASH = re.compile(r"^\s*(?P<dash>[-–—•*])(?=\w)|^\s*(?P<other>[–—•*])\s")
_PLAIN = re.compile(r"[^'\"#{\[]*")
_NO_COLON = re.compile(rf"{_LEAD}{_KEY}[ ]+(?!.*:(\s|$))(?P<rest>[^\s#].*)$")

QUOTE_INSIDE = "inside { … } and [ … ], quote texts with ':', '?', ',' or brackets in them"
_COMMENT = "a '#' after a space starts a comment: put quotes around the text"
_CLOSING = {"{": "}", "[": "]"}
_DELIMITERS = " \t\r\n,;:{}[]"


@dataclass(frozen=True, kw_only=True)
class SyntaxHint:
    """Syntax error and how to fix it.

    Attributes:
        fix: The edit that fixes it, if unambiguous; reading then continues.
        is_item: Whether the line may be meant as a '-' item.
    """

    index: int
    width: int = 1
    message: str
    hint: str
    fix: Edit | None = None
    code: str = "syntax"
    is_item: bool = False


def line_hint(line: str, start: int) -> SyntaxHint | None:
    """Return a hint for the line that starts at an index of the text; None if it looks correct."""
    dash = _DASH.match(line)
    if dash is not None:
        return _dash(dash, start)
    no_colon = _NO_COLON.match(line)
    found = comment_hint(line, start) or key_hint(line, start)
    return found or (_without_colon(no_colon, start) if no_colon else None)


def comment_hint(line: str, start: int) -> SyntaxHint | None:
    """Return a hint for a comment of another language, like :func:`line_hint`."""
    comment = COMMENT.search(line)
    if comment is None or not _PLAIN.fullmatch(line, 0, comment.start()):
        return None
    at = start + comment.start()
    return SyntaxHint(
        index=at,
        width=2,
        message=f"'{comment[0]}' starts no comment here",
        hint=f"write '# {ellipsize(line[comment.end() :].strip(' */'))}'",
        fix=Edit(start=at, stop=at + 2, text="# "),
    )


def key_hint(line: str, start: int) -> SyntaxHint | None:
    """Return a hint for why a line is not ``key: value``, like :func:`line_hint`."""
    for pattern, explain in _NO_KEY:
        match = pattern.match(line)
        if match is not None:
            return explain(match, start)
    return None


def _wide_colon(match: re.Match[str], start: int) -> SyntaxHint:
    at = start + match.start("colon")
    return SyntaxHint(
        index=at,
        message=f"'{match['colon']}' looks like a colon, but is another character",
        hint=f"write '{ellipsize(match['key'])}: …'",
        fix=Edit(start=at, stop=at + 1, text=": "),
    )


def _no_space(match: re.Match[str], start: int) -> SyntaxHint:
    at = start + match.end()
    return SyntaxHint(
        index=at - 1,
        message=f"a space is missing after '{ellipsize(match['key'])}:'",
        hint=_with_value(match),
        fix=Edit(start=at, stop=at, text=" "),
    )


def _one_word(match: re.Match[str], start: int) -> SyntaxHint:
    at = start + match.end("key")
    return SyntaxHint(
        index=start + match.start("key"),
        width=len(match["key"]),
        message=f"a ':' is missing after '{ellipsize(match['key'])}'",
        hint=f"write '{ellipsize(match['key'])}:'",
        fix=Edit(start=at, stop=at, text=":"),
    )


def _equals(match: re.Match[str], start: int) -> SyntaxHint:
    at = start + match.end() - 1
    return SyntaxHint(
        index=at,
        message=f"'=' follows '{ellipsize(match['key'])}', expected ':'",
        hint=_with_value(match),
        fix=Edit(start=at, stop=at + 1, text=":"),
    )


def _with_value(match: re.Match[str]) -> str:
    value = match.string[match.end() :].strip()[:30]
    return f"write '{ellipsize(match['key'])}: {value}'"


_NO_KEY: tuple[tuple[re.Pattern[str], Callable[[re.Match[str], int], SyntaxHint]], ...] = (
    (_WIDE_COLON, _wide_colon),
    (_NO_SPACE, _no_space),
    (_ONE_WORD, _one_word),
    (_EQUALS, _equals),
)


def _dash(match: re.Match[str], start: int) -> SyntaxHint:
    group = "dash" if match["dash"] else "other"
    at, mark = start + match.start(group), match[group]
    if mark == "-":
        return SyntaxHint(
            index=at,
            message="a space is missing after '-'",
            hint=f"write '- {match.string.strip()[1:31]}'",
            fix=Edit(start=at + 1, stop=at + 1, text=" "),
            is_item=True,
        )
    return SyntaxHint(
        index=at,
        message=f"'{mark}' cannot start an item of a list",
        hint="write '- ', a minus sign and a space",
        fix=Edit(start=at, stop=at + 1, text="- " if group == "dash" else "-"),
    )


def _without_colon(match: re.Match[str], start: int) -> SyntaxHint:
    key, rest = ellipsize(match["key"]), match["rest"].strip()[:30]
    return SyntaxHint(
        index=start + match.start("key"),
        width=len(match.string.rstrip()) - match.start("key"),
        message="this line is neither 'key: value' nor a '-' item",
        hint=f"write '{key}: {rest}', or indent the line if it belongs to the text above",
        is_item=True,
    )


def in_brackets(source: Source, index: int, begun: int) -> SyntaxHint:
    """Return the error between an open bracket and the place where the parser stopped."""
    text = source.text
    found = text[index : index + 1]
    if found == "{" and text[max(0, index - 2) : index].endswith("$"):
        return SyntaxHint(
            index=index - 1,
            message="${…} stands without quotes inside { … } or [ … ]",
            hint='quote it there: "${name}"',
            fix=_quoted(text, index),
        )
    bracket = text[begun : begun + 1] or "{"
    closing = _CLOSING.get(bracket, "}")
    word = _word_before(text, index) if found == ":" else ""
    at = index - len(word)
    at_end = index >= len(text.rstrip())
    if at_end or (word and _no_deeper(source, at, begun)):
        inside = text[: line_start(source, at)] if word else text
        return SyntaxHint(
            index=begun,
            message=f"this '{bracket}' is not closed",
            hint=_COMMENT
            if " #" in line_at(source, line_start(source, begun))
            else f"close it with '{closing}' at the end of the value",
            fix=_inserted(text, begun, len(inside.rstrip()), closing) if not at_end else None,
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


_VALUE_AFTER = re.compile(r"[^\n}]*}[^\n,\[\]{}]*")


def _quoted(text: str, index: int) -> Edit | None:
    """Return the edit that quotes the value with the ``${`` that ends at an index."""
    begin = max(text.rfind(mark, 0, index) for mark in ("{", "[", ",", ": ", "\n")) + 1
    begin += len(text[begin:index]) - len(text[begin:index].lstrip())
    after = _VALUE_AFTER.match(text, index)
    value = text[begin : after.end()].rstrip() if after is not None else ""
    if not value or '"' in value or "\\" in value:
        return None
    return Edit(start=begin, stop=begin + len(value), text=f'"{value}"')


def _word_before(text: str, index: int) -> str:
    at = index
    while at and text[at - 1] not in _DELIMITERS:
        at -= 1
    return text[at:index]


def _is_key(text: str, at: int, word: str) -> bool:
    """Return whether a word with a colon looks like the next key, not like a text."""
    before = text[:at].rstrip()
    return "\n" in text[len(before) : at] and word.strip("'\"").isidentifier()


def _inserted(text: str, begun: int, at: int, closing: str) -> Edit | None:
    return None if "#" in text[begun:at] else Edit(start=at, stop=at, text=closing)


def _no_deeper(source: Source, index: int, begun: int) -> bool:
    """Return whether a place is indented no deeper than the line where something began."""
    line = line_at(source, line_start(source, begun))
    return source.position(index).column <= indentation(line) + 1


def after_value(source: Source, index: int) -> SyntaxHint:
    """Return the error for text after the end of a value."""
    found = source.text[index : index + 1]
    comment = comment_hint(line_at(source, index), index)
    if comment is not None and comment.index == index:
        return comment
    if found in _CLOSING.values():
        return SyntaxHint(
            index=index,
            message=f"there is no open bracket that this '{found}' could close",
            hint="remove it",
            fix=Edit(start=index, stop=index + 1, text=" "),
        )
    message = "something follows the end of a value"
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
