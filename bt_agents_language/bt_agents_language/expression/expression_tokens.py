# SPDX-License-Identifier: Apache-2.0
"""Tokens of an expression: numbers, quoted texts, names, operators, each with its column."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from importlib.resources import files

import yaml

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import ellipsize
from bt_agents_language.expression.units import dimension_of

MAX_TOKENS = 400
"""Maximum number of words in an expression; evaluation nests at most half as deep."""

OPERATOR_WORDS = ("and", "or", "not", "in", "between", "else")

NAME = r"[^\W\d]\w*(?:\.\w+)*"

HINTS: Mapping[str, Mapping[str, str]] = yaml.load(
    files("bt_agents_language").joinpath("expression/hints.yaml").read_text(encoding="utf-8"),
    Loader=yaml.CSafeLoader,
)
"""Syntax of other languages → ours, by the kind of word."""

_WORDS = frozenset((*OPERATOR_WORDS, "true", "false"))

_HALVES_OF_A_DAY = {"am": 0, "pm": 12}
"""Half of a day by its name → its first hour."""

_NUMBER_LIKE = re.compile(r"[\w.]+")
_UNIT = re.compile(r"([0-9.]+)([^\W\d_]+)")
_TOKEN = re.compile(
    rf"""
    \s*(?:
    (?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)
    | (?P<not_in>not\s+in\b)
    | (?P<name>{NAME})
    | (?P<foreign>{"|".join(map(re.escape, HINTS["signs"]))})
    | (?P<operator>==|!=|<=|>=|<|>|\+|-|\*|/|%|\(|\)|\[|\]|,)
    | (?P<text>"[^"]*"|'[^']*')
    )
    """,
    re.VERBOSE,
)


class ExpressionError(BtAgentsError):
    """An expression that is not understood, or whose values do not fit.

    The column counts from 1 in the parsed text, and ``width`` characters are wrong there; the hint
    may be empty.
    """

    def __init__(self, message: str, column: int, hint: str = "", width: int = 1) -> None:
        super().__init__(message)
        self.message = message
        self.column = column
        self.hint = hint
        self.width = max(width, 1)


class TokenKind(Enum):
    """Kinds of words."""

    NUMBER = "number"
    TEXT = "text"
    BOOLEAN = "boolean"
    NAME = "name"
    OPERATOR = "operator"
    END = "end"


@dataclass(slots=True, eq=False)
class Token:
    """Word; ``column`` counts from 1, ``value`` is the value of a number, text or boolean."""

    kind: TokenKind
    text: str
    column: int
    value: bool | int | float | str = ""

    def error(self, message: str, hint: str = "") -> ExpressionError:
        """Return an error at this word."""
        return ExpressionError(message, self.column, hint, len(self.text))


def tokenize(text: str) -> list[Token]:
    """Return the words of an expression, and a last one that marks the end.

    Raises:
        ExpressionError: There is something else than words, or there are too many.
    """
    tokens: list[Token] = []
    at, end = 0, len(text.rstrip())
    while at < end:
        match = _TOKEN.match(text, at)
        if match is None:
            raise _unreadable(text, end - len(text[at:end].lstrip()))
        tokens.append(_token(match))
        at = match.end()
        if len(tokens) > MAX_TOKENS:
            raise ExpressionError(
                f"the expression has more than {MAX_TOKENS} words and signs",
                tokens[-1].column,
                "split it over several nodes",
            )
    tokens.append(Token(TokenKind.END, "", end + 1))
    return tokens


def _token(match: re.Match[str]) -> Token:
    kind = match.lastgroup
    assert kind is not None
    token = Token(TokenKind.OPERATOR, match[kind], match.start(kind) + 1)
    if kind == "name":
        return _name(token)
    if kind == "number":
        rest = _NUMBER_LIKE.match(match.string, match.end())
        if rest is not None:
            raise _bad_number(token.text + rest[0], token.column)
        return Token(TokenKind.NUMBER, token.text, token.column, _number(token))
    if kind == "not_in":
        return Token(TokenKind.OPERATOR, "not in", token.column)
    if kind == "foreign":
        raise token.error(f"there is no operator '{token.text}'", HINTS["signs"][token.text])
    if kind == "text":
        _refuse_protected_quote(token.text, match)
        return Token(TokenKind.TEXT, token.text, token.column, token.text[1:-1])
    return token


def _name(token: Token) -> Token:
    word, lowered = token.text, token.text.lower()
    if lowered not in _WORDS:
        return Token(TokenKind.NAME, word, token.column)
    if lowered != word:
        raise token.error(f"'{word}' is written with capital letters", f"write {lowered}")
    if word in OPERATOR_WORDS:
        return token
    return Token(TokenKind.BOOLEAN, word, token.column, word == "true")


def unit_hint(amount: str, unit: str) -> str:
    """Return how to write a number with a unit; empty if it is not a unit."""
    if unit.lower() in _HALVES_OF_A_DAY and amount.isdecimal() and 1 <= int(amount[:3]) <= 12:
        hour = int(amount) % 12 + _HALVES_OF_A_DAY[unit.lower()]
        return f"compare clock.hour, from 0 to 23: write {hour}"
    dimension = dimension_of(unit)
    if dimension is None:
        return ""
    value = dimension.si_value(float(amount), unit)
    return f"numbers have no unit here: write {value:g} ({dimension.si})"


def _bad_number(word: str, column: int) -> ExpressionError:
    hint = ""
    unit = _UNIT.fullmatch(word)
    if re.fullmatch("[0-9][0-9_]*", word):
        hint = f"write {word.replace('_', '')}"
    elif re.fullmatch("0[xX][0-9a-fA-F]{1,12}", word):
        hint = f"write {int(word, 16)}"
    elif unit and unit[1].count(".") < 2 and unit[1] != ".":
        hint = unit_hint(unit[1], unit[2]) or "names start with a letter"
    return ExpressionError(
        f"'{ellipsize(word)}' is neither a number nor a name", column, hint, len(word)
    )


def _number(token: Token) -> int | float:
    word = token.text
    if word[0] == "0" and word[1:2].isdecimal():
        raise token.error(
            f"'{ellipsize(word)}' starts with a zero, which some programs read as another number",
            f"write {ellipsize(word.lstrip('0') or '0')}",
        )
    if word.isdigit() and len(word) <= 18:
        return int(word)
    value = float(word)
    if not math.isfinite(value):
        raise token.error(f"'{ellipsize(word)}' is too large for a number")
    return value


def _refuse_protected_quote(word: str, match: re.Match[str]) -> None:
    """Refuse a quotation mark after a backslash, which would fail only far after its cause."""
    following = match.string[match.end() : match.end() + 1]
    if word[-2] == "\\" and following.isalnum():
        other = '"' if word[0] == "'" else "'"
        raise ExpressionError(
            "a backslash does not protect the quotation mark after it",
            match.end() - 1,
            f"put the whole text in {other}…{other}",
        )


def _unreadable(text: str, at: int) -> ExpressionError:
    character = text[at]
    if character in "'\"":
        return ExpressionError(
            "this quotation mark is not closed", at + 1, f"close the text with {character}"
        )
    hint = HINTS["characters"].get(character, "")
    if character == ":" and text[at - 1 : at].isdecimal():
        hint = "times are numbers of seconds here: 1:30 is 90"
    return ExpressionError(f"'{character}' means nothing in an expression", at + 1, hint)
