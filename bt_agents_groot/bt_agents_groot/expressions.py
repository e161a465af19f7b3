# SPDX-License-Identifier: Apache-2.0
"""Conversion of our expressions to formulas, and of our conditions and values to scripts."""

from __future__ import annotations

from bt_agents_groot.formulas import (
    ARITHMETIC,
    COMPARISONS,
    Binary,
    Call,
    Constant,
    Formula,
    Name,
    Unary,
    Untranslatable,
    as_script,
    names_in_formula,
    negated,
    negative,
    script_name,
)
from bt_agents_groot.ports import REFERENCE
from bt_agents_groot.scripts import MAX_TOKENS
from bt_agents_language.expression.expression_tokens import Token, TokenKind, tokenize
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar

_STRENGTH = {
    "or": 1, "and": 2, **dict.fromkeys(COMPARISONS, 4), "in": 4, "not in": 4, "between": 4,
    "not": 4, **dict.fromkeys(ARITHMETIC, 6), "+": 5, "-": 5,
    "else": 8,
}  # fmt: skip
_NOT, _MINUS = 3, 7


def parse_formula(text: str) -> Formula:
    """Return the formula for a checked expression of our language.

    ``a between b and c`` becomes two comparisons.

    Raises:
        Untranslatable: It is too long for a script.
    """
    tokens = tokenize(text)
    if len(tokens) > MAX_TOKENS:
        raise Untranslatable(f"a script has at most {MAX_TOKENS} words")
    return _Parser(tokens).formula(0)


def condition_script(node: Node, *, opposite: bool = False) -> str:
    """Return a condition or its negation as a script.

    Raises:
        Untranslatable: Scripts cannot express it.
    """
    assert isinstance(node, Scalar)
    formula = parse_formula(node.text)
    return as_script(negated(formula) if opposite else formula)


def set_script(entries: tuple[MappingEntry, ...]) -> str:
    """Return the script that sets names to values.

    Raises:
        Untranslatable: A value has no equivalent, or needs a name that is set together with it.
    """
    statements: list[str] = []
    names: set[str] = set()
    for entry in entries:
        if "." in entry.key.text:
            raise Untranslatable("a script sets names of its blackboard only")
        value = _formula(entry.value)
        if names & set(names_in_formula(value)):
            raise Untranslatable("the values of a script follow each other")
        names.add(entry.key.text)
        statements.append(f"{script_name(entry.key.text)} := {as_script(value)}")
    return "; ".join(statements)


class _Parser:
    """Pratt parser for checked tokens."""

    def __init__(self, tokens: list[Token]) -> None:
        self._tokens = tokens
        self._next = 0

    def _take(self) -> Token:
        token = self._tokens[self._next]
        self._next += 1
        return token

    def formula(self, weakest: int) -> Formula:
        """Read operands that are joined by operators stronger than ``weakest``."""
        left = self._operand()
        while True:
            operator = self._tokens[self._next].text
            if self._tokens[self._next].kind is TokenKind.TEXT:
                return left
            strength = _STRENGTH.get(operator, 0)
            if strength <= weakest:
                return left
            self._take()
            left = self._infix(operator, left)

    def _infix(self, operator: str, left: Formula) -> Formula:
        if operator == "not":
            return Unary("not", self._infix(self._take().text, left))
        if operator == "not in":
            return Unary("not", Binary("in", left, self.formula(_STRENGTH["in"])))
        if operator == "between":
            low = self.formula(_STRENGTH["between"])
            self._take()
            high = self.formula(_STRENGTH["between"])
            return Binary("and", Binary("<=", low, left), Binary("<=", left, high))
        return Binary(operator, left, self.formula(_STRENGTH[operator]))

    def _operand(self) -> Formula:
        token = self._take()
        match token.kind:
            case TokenKind.NUMBER | TokenKind.TEXT | TokenKind.BOOLEAN:
                return Constant(token.value)
        match token.text:
            case "not":
                return Unary("not", self.formula(_NOT))
            case "-":
                return negative(self.formula(_MINUS))
            case "(":
                inner = self.formula(0)
                self._take()
                return inner
            case "[":
                return Call("[", self._arguments("]"))
        if self._tokens[self._next].text == "(":
            self._take()
            return Call(token.text, self._arguments(")"))
        return Name(token.text)

    def _arguments(self, closing: str) -> tuple[Formula, ...]:
        arguments: list[Formula] = []
        while self._tokens[self._next].text != closing:
            arguments.append(self.formula(0))
            if self._tokens[self._next].text == ",":
                self._take()
        self._take()
        return tuple(arguments)


def _formula(node: Node) -> Formula:
    if not isinstance(node, Scalar):
        raise Untranslatable("scripts have no lists and mappings")
    if "${" not in node.text:
        value = plain_value(node)
        if not isinstance(value, bool | int | float | str):
            raise Untranslatable("scripts have no such value")
        return Constant(value)
    plain, *rest = REFERENCE.split(node.text)
    pieces: list[Formula] = []
    for expression, following in zip(rest[::2], rest[1::2], strict=True):
        if expression is None:
            plain += "${" + following
            continue
        if plain:
            pieces.append(Constant(plain))
        pieces.append(parse_formula(expression.strip()))
        plain = following
    if plain or not pieces:
        pieces.append(Constant(plain))
    whole = pieces[0]
    for piece in pieces[1:]:
        whole = Binary("..", whole, piece)
    return whole
