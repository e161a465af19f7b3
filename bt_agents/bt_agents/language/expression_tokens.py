# SPDX-License-Identifier: Apache-2.0
"""The words of a condition: numbers, quoted texts, names and operators, each with its column."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import Enum

from bt_agents.errors import BtAgentsError

WORDS = ("and", "or", "not")
"""Operators that are words."""

_TOKEN = re.compile(
    r"""
    (?P<space>\s+)
    | (?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)
    | (?P<name>[^\W\d]\w*(?:\.\w+)*)
    | (?P<text>"[^"]*"|'[^']*')
    | (?P<operator>==|!=|<=|>=|<|>|\+|-|\*|/|%|\(|\))
    """,
    re.VERBOSE,
)
_SLIPS = {
    "=": "compare with ==",
    "&": "write and",
    "|": "write or",
    "!": "write not",
    "$": "in conditions names stand alone, without ${ }",
    "{": "in conditions names stand alone, without ${ }",
    "^": "powers are not possible",
    "'": "close the text with '",
    '"': 'close the text with "',
    "“": 'use straight quotes: "…"',
    "”": 'use straight quotes: "…"',
    "„": 'use straight quotes: "…"',
    "’": "use straight quotes: '…'",
    "≤": "write <=",
    "≥": "write >=",
    "≠": "write !=",
    "−": "write the plain minus sign -",
    "–": "write the plain minus sign -",
    ",": "write decimals with a point: 1.5",
}
_COMPARISON_SLIPS = {"=<": "<=", "=>": ">=", "<>": "!=", "===": "=="}


class ExpressionError(BtAgentsError):
    """An expression that cannot be understood, or whose values do not fit.

    Attributes:
        message: What was found and what is expected.
        column: Where, counted from 1 in the text that was parsed.
        hint: How to mend it; may be empty.
    """

    def __init__(self, message: str, column: int, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.column = column
        self.hint = hint


class TokenKind(Enum):
    """Kinds of words."""

    NUMBER = "number"
    TEXT = "text"
    BOOLEAN = "boolean"
    NAME = "name"
    OPERATOR = "operator"
    END = "end"


@dataclass(frozen=True)
class Token:
    """One word; ``column`` counts from 1, ``value`` is that of a number, text or boolean."""

    kind: TokenKind
    text: str
    column: int
    value: bool | int | float | str = ""


def tokenize(text: str) -> list[Token]:
    """Return the words of an expression, the end marked by a last one.

    Raises:
        ExpressionError: There is something that is no word.
    """
    tokens: list[Token] = []
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise _unreadable(text, at)
        _refuse_slip(text, at)
        at = match.end()
        if match.lastgroup != "space":
            tokens.append(_token(match, text))
    tokens.append(Token(TokenKind.END, "", len(text.rstrip()) + 1))
    return tokens


def _token(match: re.Match[str], text: str) -> Token:
    word, column = match[0], match.start() + 1
    match match.lastgroup:
        case "number":
            following = text[match.end() : match.end() + 1]
            if following.isalnum() or following in ("_", "."):
                raise ExpressionError(
                    f"'{word}{following}…' is neither a number nor a name",
                    column,
                    "times in conditions are seconds, without a unit",
                )
            return Token(TokenKind.NUMBER, word, column, _number(word, column))
        case "text":
            return Token(TokenKind.TEXT, word, column, word[1:-1])
        case "operator":
            return Token(TokenKind.OPERATOR, word, column)
    if word in WORDS:
        return Token(TokenKind.OPERATOR, word, column)
    if word in ("true", "false"):
        return Token(TokenKind.BOOLEAN, word, column, word == "true")
    if word.lower() in (*WORDS, "true", "false"):
        raise ExpressionError(
            f"'{word}' is written with capital letters", column, f"write {word.lower()}"
        )
    return Token(TokenKind.NAME, word, column)


def _number(word: str, column: int) -> int | float:
    if re.match("0[0-9]", word):
        raise ExpressionError(
            f"'{word}' starts with a zero, which some programs read as another number",
            column,
            f"write {word.lstrip('0') or '0'}",
        )
    if word.isdigit() and len(word) <= 18:
        return int(word)
    value = float(word)
    if not math.isfinite(value):
        raise ExpressionError(f"'{word}' is too large for a number", column)
    return value


def _refuse_slip(text: str, at: int) -> None:
    for slip, meant in _COMPARISON_SLIPS.items():
        if text.startswith(slip, at):
            raise ExpressionError(f"there is no operator '{slip}'", at + 1, f"write {meant}")


def _unreadable(text: str, at: int) -> ExpressionError:
    for slip, meant in _COMPARISON_SLIPS.items():
        if text.startswith(slip, at):
            return ExpressionError(f"there is no operator '{slip}'", at + 1, f"write {meant}")
    character = text[at]
    if character in "'\"":
        return ExpressionError("this quotation mark is not closed", at + 1, _SLIPS[character])
    return ExpressionError(
        f"'{character}' means nothing in a condition", at + 1, _SLIPS.get(character, "")
    )
