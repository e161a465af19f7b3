# SPDX-License-Identifier: Apache-2.0
"""Syntax hints for a line that is meant as 'key: value' or as a '-' item."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from bt_agents_core.text import ellipsize
from bt_agents_language.yaml.source import Edit

_LEAD = r"^(?P<lead>\s*(?:-\s+)*)"
_KEY = r"(?P<key>[^\W\d][\w-]*)"
_NO_SPACE = re.compile(rf"{_LEAD}{_KEY}:(?=[^\s/])")
_ONE_WORD = re.compile(rf"{_LEAD}{_KEY}\s*(?:#.*)?$")
_EQUALS = re.compile(rf"{_LEAD}{_KEY}\s*=(?=\s)")
_WIDE_COLON = re.compile(rf"{_LEAD}{_KEY}\s*(?P<colon>[：︰﹕∶ː])")  # noqa: RUF001 - meant
_DASH = re.compile(r"^\s*(?P<dash>[-–—•*])(?=\w)|^\s*(?P<other>[–—•*])\s")
_NO_COLON = re.compile(rf"{_LEAD}{_KEY}[ ]+(?!.*:(\s|$))(?P<rest>[^\s#].*)$")


@dataclass(frozen=True, kw_only=True)
class SyntaxHint:
    """A syntax error and how to fix it.

    Attributes:
        fix: The edit that fixes it, where there is no doubt; reading then goes on.
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
    """Return a hint for a line that starts at an index of the text; None when it looks sound."""
    dash = _DASH.match(line)
    if dash is not None:
        return _dash(dash, start)
    no_colon = _NO_COLON.match(line)
    return key_hint(line, start) or (_without_colon(no_colon, start) if no_colon else None)


def key_hint(line: str, start: int) -> SyntaxHint | None:
    """Return a hint for what keeps a line from being ``key: value``; as :func:`line_hint`."""
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
        message=f"a space is missing behind '{ellipsize(match['key'])}:'",
        hint=_with_value(match),
        fix=Edit(start=at, stop=at, text=" "),
    )


def _one_word(match: re.Match[str], start: int) -> SyntaxHint:
    at = start + match.end("key")
    return SyntaxHint(
        index=start + match.start("key"),
        width=len(match["key"]),
        message=f"a ':' is missing behind '{ellipsize(match['key'])}'",
        hint=f"write '{ellipsize(match['key'])}:'",
        fix=Edit(start=at, stop=at, text=":"),
    )


def _equals(match: re.Match[str], start: int) -> SyntaxHint:
    at = start + match.end() - 1
    return SyntaxHint(
        index=at,
        message=f"'=' stands behind '{ellipsize(match['key'])}', expected ':'",
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
            message="a space is missing behind '-'",
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
