# SPDX-License-Identifier: Apache-2.0
"""Hints for common mistakes in expressions: words of other languages, units, missing brackets."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable

from bt_agents_core.scene import Labels
from bt_agents_core.text import ellipsize
from bt_agents_language.expression.expression_tokens import (
    HINTS,
    NAME,
    ExpressionError,
    Token,
    TokenKind,
    unit_hint,
)
from bt_agents_language.expression.ranges import Range

NO_VALUES = ("null", "None", "nil", "undefined", "NULL", "none")
"""Words of other languages for a missing value."""

ABSENT = (*NO_VALUES, "missing", "unknown", "known", "nothing", "unset")
"""Words that people use to ask whether a value exists."""

ABSENT_HINT = "ask whether a name has a value with known(x), or give it one with 'else': x else 1"


def unknown_function(token: Token, functions: Iterable[str]) -> ExpressionError:
    """Return the error for a name that an opening parenthesis follows."""
    known = list(functions)
    value, dot, method = token.text.rpartition(".")
    if dot:
        hint = HINTS["methods"].get(method.lower(), f"possible are {', '.join(known)}")
        return token.error(
            f"values have no functions of their own: '{ellipsize(token.text)}(…)'",
            hint.format(ellipsize(value)),
        )
    word = token.text
    hint = HINTS["no_functions"].get(word.lower(), "")
    if not hint:
        folded = word.lower()
        near = difflib.get_close_matches(folded, known, n=1, cutoff=0.6) if len(word) < 40 else []
        meant = HINTS["functions"].get(folded) or (near[0] if near else "")
        hint = f"did you mean '{meant}'?" if meant else f"possible are {', '.join(known)}"
    return token.error(f"there is no function '{ellipsize(word)}'", hint)


def no_value(token: Token) -> ExpressionError:
    """Return the error for one of :data:`NO_VALUES`."""
    return token.error(f"'{token.text}' is not a value", ABSENT_HINT)


def with_phrase(
    error: ExpressionError, text: str, range_of: Callable[[str], Range | None]
) -> ExpressionError:
    """Return the error, with a hint if the text contains a common phrase."""
    hint = _share_hint(text, range_of)
    for pattern, said in HINTS["phrases"].items():
        match = re.search(pattern, text, re.IGNORECASE)
        if match is not None:
            hint = match.expand(said)
            break
    return ExpressionError(error.message, error.column, hint, error.width) if hint else error


_SHARE = re.compile(rf"({NAME})\s*([<>]=?|==)\s*([0-9]{{1,3}})\s*%(?!\s*[\w(])")


def _share_hint(text: str, range_of: Callable[[str], Range | None]) -> str:
    """Return how to compare with a share of a range; empty if the text does not do that."""
    match = _SHARE.search(text)
    if match is None:
        return ""
    name, sign, share = match.groups()
    limits = range_of(name)
    if limits is None:
        return "'%' is the remainder of a division; write a plain number"
    value = limits.low + (limits.high - limits.low) * float(share) / 100
    return (
        f"write {ellipsize(name)} {sign} {value:g}, which is {share} % of the way from "
        f"{limits.low:g} to {limits.high:g}"
    )


def label_hint(name: str, sign: str, word: str) -> str:
    """Return how to compare a parameter with one of its labels."""
    return f"write label({ellipsize(name)}) {sign} '{ellipsize(word)}'"


def unexpected(
    token: Token, before: Token | None, after: Token | None, labels: Labels | None
) -> ExpressionError:
    """Return the error for a word where an operator or the end is expected.

    Args:
        token: The word.
        before: The word before it.
        after: The word after it.
        labels: Words for the values of a parameter before it.
    """
    if token.text.lower() == "is" and after is not None and after.text in (*ABSENT, "not"):
        hint = ABSENT_HINT if after.text in ABSENT else "write !="
        return token.error("an operator is expected before 'is'", hint)
    if labels and before is not None and after is not None and after.kind is TokenKind.NAME:
        sign = HINTS["operators"].get(token.text.lower(), "").removeprefix("write ")
        if sign in ("==", "!="):
            hint = label_hint(before.text, sign, after.text)
            return token.error(f"an operator is expected before '{token.text}'", hint)
    if token.text == ")":
        return token.error("this ')' closes nothing", "remove it")
    if token.text == "]":
        return token.error("this ']' closes nothing", "remove it")
    if token.text == "[" and before is not None and before.kind is TokenKind.NAME:
        message = before.text.startswith(("msg.", "result."))
        return token.error(
            "an item is not picked with brackets",
            f"write its index after a dot, counted from 0: {ellipsize(before.text)}.0"
            if message
            else f"look for a value with 'in': 'word' in {ellipsize(before.text)}",
        )
    return token.error(
        f"an operator is expected before '{ellipsize(token.text)}'", _between(token, before)
    )


def _between(token: Token, before: Token | None) -> str:
    if token.kind is TokenKind.NAME and token.text.lower() in HINTS["operators"]:
        return HINTS["operators"][token.text.lower()]
    if token.text == "not":
        return "write 'not' before the whole comparison: not x between 2 and 4"
    if token.text == ",":
        if before is not None and before.kind is TokenKind.NUMBER:
            return "write decimals with a point: 1.5; write a list in brackets: [1, 5]"
        return "write a list in brackets: ['a', 'b']"
    if token.kind is TokenKind.NAME and before is not None and before.kind is TokenKind.NUMBER:
        hint = unit_hint(before.text, token.text)
        if hint:
            return hint
        if "." not in token.text:
            return (
                f"numbers have no unit here: write {before.text}; join conditions with 'and' or "
                "'or'"
            )
    return "join conditions with 'and' or 'or', and put texts in quotes"


def no_operand(token: Token) -> ExpressionError:
    """Return the error for a word where a value is expected."""
    if token.kind is TokenKind.END:
        return token.error("the expression ends where a value is expected")
    hint = ""
    if token.text == "+":
        hint = "remove the +"
    elif token.text in ("]", ")", ","):
        hint = "write a value, or remove the comma" if token.text != "," else "write a value"
    elif token.kind is TokenKind.OPERATOR:
        hint = "write a value or name before it"
    return token.error(f"a value or name is expected, found '{ellipsize(token.text)}'", hint)


def bad_between(token: Token) -> ExpressionError:
    """Return the error for ``between`` without its ``and``."""
    found = "the end" if token.kind is TokenKind.END else f"'{ellipsize(token.text)}'"
    return token.error(
        f"'between' needs two numbers joined with 'and', found {found}", "write between 2 and 4"
    )
