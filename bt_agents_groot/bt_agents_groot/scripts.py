# SPDX-License-Identifier: Apache-2.0
"""Parser of the script language of BehaviorTree.CPP: assignments and conditions."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from bt_agents_core.errors import BtAgentsError
from bt_agents_groot.formulas import (
    COMPARISONS,
    Binary,
    Conditional,
    Constant,
    Formula,
    Name,
    Unary,
    negative,
)

MAX_TOKENS = 400
"""Maximum number of tokens in a script; formulas of this size do not exhaust the stack."""

MAX_DEPTH = 32
"""Maximum nesting of parentheses and signs."""

_TOKEN = re.compile(
    r"""
    (?P<space>[ \t\r\n]+)
    | (?P<text>'[^']*'|"[^"]*")
    | (?P<hex>0[xX][0-9a-fA-F]+(?![\w.]))
    | (?P<number>[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?(?![\w]|\.(?!\.)))
    | (?P<name>[A-Za-z_@][A-Za-z0-9_]*)
    | (?P<operator>\.\.|&&|\|\||==|!=|<=|>=|:=|\+=|-=|\*=|/=|[-+*/&|^~!<>=?:();])
    | (?P<unknown>.)
    """,
    re.VERBOSE | re.DOTALL,
)
_ASSIGNMENTS = {":=": "", "=": "", "+=": "+", "-=": "-", "*=": "*", "/=": "/"}
_STRENGTH = {
    "?": 4, "||": 6, "&&": 8, **dict.fromkeys(COMPARISONS, 10), "|": 12, "^": 12, "&": 14,
    "+": 16, "-": 16, "..": 16, "*": 18, "/": 18,
}  # fmt: skip
_PREFIX = 20
_OPERATORS = {"||": "or", "&&": "and"}
_SIGNS = {"!": "not", "~": "~"}


class ScriptError(BtAgentsError):
    """Syntax error at an index of a script: what was found and what is expected."""

    def __init__(self, message: str, offset: int) -> None:
        super().__init__(message)
        self.message = message
        self.offset = offset


@dataclass(frozen=True)
class Assignment:
    """``name := value``; ``x += 1`` is the assignment of ``x + 1``."""

    name: str
    value: Formula


Statement = Assignment | Formula


def parse_script(text: str, rename: Callable[[str], str]) -> list[Statement]:
    """Return the statements of a script.

    From weak to strong: ``? :``, ``||``, ``&&``, comparisons (``a < b < c`` compares twice),
    ``| ^``, ``&``, ``+ - ..``, ``* /``, signs. The rules are as in ``script_parser.cpp`` of
    BehaviorTree.CPP 4.7, but without names of enums, because only a program knows its enums.

    Raises:
        ScriptError: The text is not a script.
    """
    parser = _Parser(_tokens(text), rename)
    statements: list[Statement] = []
    while not parser.at_end:
        statements.append(parser.statement())
    if not statements:
        raise ScriptError("there is no script", 0)
    return statements


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    offset: int


def _tokens(text: str) -> list[_Token]:
    tokens: list[_Token] = []
    for match in _TOKEN.finditer(text):
        kind, at = match.lastgroup or "", match.start()
        if kind == "unknown":
            if match[0] in ("'", '"'):
                raise ScriptError("this quotation mark is not closed", at)
            raise ScriptError(f"'{text[at : at + 12]}' means nothing in a script", at)
        if kind != "space":
            tokens.append(_Token(kind, match[0], at))
        if len(tokens) > MAX_TOKENS:
            raise ScriptError(f"the script has more than {MAX_TOKENS} words; split it", at)
    return [*tokens, _Token("end", "", len(text))]


class _Parser:
    """Pratt parser for the tokens of one script."""

    def __init__(self, tokens: list[_Token], rename: Callable[[str], str]) -> None:
        self._tokens = tokens
        self._rename = rename
        self._next = 0
        self._depth = 0

    @property
    def at_end(self) -> bool:
        return self._peek.kind == "end"

    @property
    def _peek(self) -> _Token:
        return self._tokens[self._next]

    def _take(self) -> _Token:
        token = self._peek
        if token.kind != "end":
            self._next += 1
        return token

    def statement(self) -> Statement:
        """Parse an assignment or a formula, and the semicolons after it."""
        start = self._peek
        statement: Statement = self._formula(0)
        if self._peek.text in _ASSIGNMENTS and self._peek.kind == "operator":
            sign = self._take()
            if not isinstance(statement, Name) or start.kind != "name":
                raise ScriptError(f"only a name can stand before '{sign.text}'", start.offset)
            value = self._formula(0)
            if _ASSIGNMENTS[sign.text]:
                value = Binary(_ASSIGNMENTS[sign.text], statement, value)
            statement = Assignment(statement.name, value)
        # The semicolon between assignments is optional.
        if not self.at_end and self._peek.text != ";" and not isinstance(statement, Assignment):
            token = self._peek
            raise ScriptError(f"an operator is expected before '{token.text}'", token.offset)
        while self._peek.text == ";":
            self._take()
        return statement

    def _formula(self, weakest: int) -> Formula:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ScriptError(
                f"the script is nested more than {MAX_DEPTH} deep", self._peek.offset
            )
        left = self._operand()
        while True:
            token = self._peek
            strength = _STRENGTH.get(token.text, -1) if token.kind == "operator" else -1
            if strength < max(weakest, 1):
                break
            if token.text == "?":
                left = self._choice(left)
                break
            left = self._comparison(left) if token.text in COMPARISONS else self._binary(left)
        self._depth -= 1
        return left

    def _binary(self, left: Formula) -> Formula:
        token = self._take()
        right = self._formula(_STRENGTH[token.text] + 1)
        if token.text == "+" and _is_text(left, right):
            return Binary("..", left, right)
        return Binary(_OPERATORS.get(token.text, token.text), left, right)

    def _comparison(self, left: Formula) -> Formula:
        """Parse ``a < b < c``, which means ``a < b and b < c``."""
        whole: Formula | None = None
        while self._peek.kind == "operator" and self._peek.text in COMPARISONS:
            token = self._take()
            right = self._formula(_STRENGTH[token.text] + 1)
            compared = Binary(token.text, left, right)
            whole = compared if whole is None else Binary("and", whole, compared)
            left = right
        assert whole is not None
        return whole

    def _choice(self, condition: Formula) -> Formula:
        self._take()
        yes = self._formula(0)
        if self._peek.text != ":":
            raise ScriptError("a ':' is expected here, as in a ? b : c", self._peek.offset)
        self._take()
        return Conditional(condition, yes, self._formula(_STRENGTH["?"]))

    def _operand(self) -> Formula:
        token = self._take()
        match token.kind:
            case "text":
                return Constant(token.text[1:-1])
            case "hex":
                return Constant(int(token.text, 16))
            case "number":
                return Constant(int(token.text) if token.text.isdigit() else float(token.text))
            case "name" if token.text in ("true", "false"):
                return Constant(token.text == "true")
            case "name":
                return Name(self._rename(token.text))
            case "operator" if token.text == "-":
                return negative(self._formula(_PREFIX))
            case "operator" if token.text in _SIGNS:
                return Unary(_SIGNS[token.text], self._formula(_PREFIX))
            case "operator" if token.text == "(":
                inner = self._formula(0)
                closing = self._take()
                if closing.text != ")":
                    raise ScriptError("this '(' is not closed", token.offset)
                return inner
            case "end":
                raise ScriptError("the script ends where a value is expected", token.offset)
        raise ScriptError(f"a value or name is expected, found '{token.text}'", token.offset)


def _is_text(*operands: Formula) -> bool:
    """Return whether an operand is definitely a text."""
    return any(
        (isinstance(one, Constant) and isinstance(one.value, str))
        or (isinstance(one, Binary) and one.operator == "..")
        for one in operands
    )
