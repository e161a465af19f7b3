# SPDX-License-Identifier: Apache-2.0
"""Syntax hints for a line that is meant as 'key: value' or as a '-' item."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from bt_agents_core.text import ellipsize
from bt_agents_language.yaml.patched_source import Edit

_LEAD = r"^(?P<lead>\s*(?:-\s+)*)"
_KEY = r"(?P<key>[^\W\d][\w-]*)"
_NO_SPACE = re.compile(rf"{_LEAD}{_KEY}:(?=[^\s/])")
_ONE_WORD = re.compile(rf"{_LEAD}{_KEY}\s*(?:#.*)?$")
_EQUALS = re.compile(rf"{_LEAD}{_KEY}\s*=(?=\s)")
_WIDE_COLON = re.compile(rf"{_LEAD}{_KEY}\s*(?P<colon>[：︰﹕∶ː])")  # noqa: RUF001 - meant
_DASH = re.compile(r"^\s*(?P<dash>[-–—•*])(?=\w)|^\s*(?P<other>[–—•*])\s")
_NO_COLON = re.compile(rf"{_LEAD}{_KEY}[ ]+(?P<rest>[^\s#].*)$")
_COLON_LATER = re.compile(r":(\s|$)")


@dataclass(frozen=True, kw_only=True)
class SyntaxHint:
    """A syntax error and how to fix it.

    Attributes:
        index: Where it begins.
        width: Number of characters.
        message: What was found and what is expected.
        hint: How to fix it.
        fix: The edit that fixes it, where there is no doubt; reading then goes on.
        code: Of the problem.
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
    """Return a hint for a line; None when nothing in it looks like one.

    Args:
        line: The line without its end.
        start: Index of its first character in the text.
    """
    for find in _FINDERS:
        hint = find(line, start)
        if hint is not None:
            return hint
    return None


def key_hint(line: str, start: int) -> SyntaxHint | None:
    """Return a hint for what keeps a line from being ``key: value``; as :func:`line_hint`."""
    for find in (_wide_colon, _no_space, _one_word, _equals):
        hint = find(line, start)
        if hint is not None:
            return hint
    return None


def _wide_colon(line: str, start: int) -> SyntaxHint | None:
    match = _WIDE_COLON.match(line)
    if match is None:
        return None
    at = start + match.start("colon")
    return SyntaxHint(
        index=at,
        message=f"'{match['colon']}' looks like a colon, but is another character",
        hint=f"write '{ellipsize(match['key'])}: …'",
        fix=Edit(start=at, stop=at + 1, text=": "),
    )


def _no_space(line: str, start: int) -> SyntaxHint | None:
    match = _NO_SPACE.match(line)
    if match is None:
        return None
    at = start + match.end()
    return SyntaxHint(
        index=at - 1,
        message=f"a space is missing behind '{ellipsize(match['key'])}:'",
        hint=f"write '{ellipsize(match['key'])}: {line[match.end() :].strip()[:30]}'",
        fix=Edit(start=at, stop=at, text=" "),
    )


def _one_word(line: str, start: int) -> SyntaxHint | None:
    match = _ONE_WORD.match(line)
    if match is None:
        return None
    at = start + match.end("key")
    return SyntaxHint(
        index=start + match.start("key"),
        width=len(match["key"]),
        message=f"a ':' is missing behind '{ellipsize(match['key'])}'",
        hint=f"write '{ellipsize(match['key'])}:'",
        fix=Edit(start=at, stop=at, text=":"),
    )


def _equals(line: str, start: int) -> SyntaxHint | None:
    match = _EQUALS.match(line)
    if match is None:
        return None
    at = start + match.end() - 1
    return SyntaxHint(
        index=at,
        message=f"'=' stands behind '{ellipsize(match['key'])}', expected ':'",
        hint=f"write '{ellipsize(match['key'])}: {line[match.end() :].strip()[:30]}'",
        fix=Edit(start=at, stop=at + 1, text=":"),
    )


def _dash(line: str, start: int) -> SyntaxHint | None:
    match = _DASH.match(line)
    if match is None:
        return None
    group = "dash" if match["dash"] else "other"
    at, mark = start + match.start(group), match[group]
    if mark == "-":
        return SyntaxHint(
            index=at,
            message="a space is missing behind '-'",
            hint=f"write '- {line.strip()[1:31]}'",
            fix=Edit(start=at + 1, stop=at + 1, text=" "),
            is_item=True,
        )
    return SyntaxHint(
        index=at,
        message=f"'{mark}' cannot start an item of a list",
        hint="write '- ', a minus sign and a space",
        fix=Edit(start=at, stop=at + 1, text="- " if group == "dash" else "-"),
    )


def _without_colon(line: str, start: int) -> SyntaxHint | None:
    match = _NO_COLON.match(line)
    if match is None or _COLON_LATER.search(line):
        return None
    key, rest = ellipsize(match["key"]), match["rest"].strip()[:30]
    return SyntaxHint(
        index=start + match.start("key"),
        width=len(line.rstrip()) - match.start("key"),
        message="this line is neither 'key: value' nor a '-' item",
        hint=f"write '{key}: {rest}', or indent the line if it belongs to the text above",
        is_item=True,
    )


_FINDERS: tuple[Callable[[str, int], SyntaxHint | None], ...] = (
    _dash,
    _wide_colon,
    _no_space,
    _one_word,
    _equals,
    _without_colon,
)
