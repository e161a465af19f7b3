# SPDX-License-Identifier: Apache-2.0
"""Conditions as authors write them, such as ``scene.age >= 4``: checked and compiled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from bt_agents.errors import BtAgentsError
from bt_agents.language.expression_tokens import (
    ExpressionError,
    Token,
    TokenKind,
    tokenize,
)
from bt_agents.language.operators import (
    BINARY,
    UNARY,
    EvaluationError,
    Evaluator,
    Lookup,
    Operator,
    ValueKind,
)

__all__ = [
    "EvaluationError",
    "Expression",
    "ExpressionError",
    "Mention",
    "MissingValue",
    "ValueKind",
    "parse_expression",
]

MAX_LENGTH = 1000
"""Characters of an expression."""

MAX_DEPTH = 32
"""Nesting of parentheses, ``not`` and minus signs."""


class MissingValue(BtAgentsError):
    """A name has no value now; a lookup raises it and an evaluation passes it on.

    Attributes:
        name: The name.
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"'{name}' has no value")
        self.name = name


@dataclass(frozen=True, kw_only=True)
class Mention:
    """A name in an expression and the column where it starts, from 1."""

    name: str
    column: int


@dataclass(frozen=True, kw_only=True)
class Expression:
    """A parsed expression; two are equal when their texts are.

    Attributes:
        text: As written, without spaces around it.
        mentions: Every name in it with its place in the text that was parsed.
        kind: Kind of its value where that is known without running it.
    """

    text: str
    mentions: tuple[Mention, ...] = field(compare=False)
    kind: ValueKind | None = field(compare=False)
    _run: Evaluator = field(compare=False, repr=False)

    @property
    def names(self) -> frozenset[str]:
        """The names in it."""
        return frozenset(mention.name for mention in self.mentions)

    def evaluate(self, lookup: Lookup) -> object:
        """Return its value.

        Args:
            lookup: Returns the value of a name.

        Raises:
            EvaluationError: Values do not fit the operators, or a division by zero.
            MissingValue: Passed on from ``lookup``.
        """
        return self._run(lookup)


def parse_expression(
    text: str,
    known: Callable[[str], bool] | None = None,
    kind_of: Callable[[str], ValueKind | None] | None = None,
) -> Expression:
    """Return the expression that a text says.

    From weak to strong: ``or``, ``and``, ``not``, one of ``== != < <= > >=``, ``+ -``, ``* / %``,
    the minus sign. Operands are numbers, quoted texts, ``true``, ``false`` and dotted names.

    Args:
        text: At most 1,000 characters.
        known: Whether a name exists; None takes every name.
        kind_of: Kind of a name's value, None where only a run shows it.

    Raises:
        ExpressionError: The text is none, or a name in it is not known.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(
            f"the condition has {len(text)} characters, at most {MAX_LENGTH} are possible",
            1,
            "split it over several nodes",
        )
    parser = _Parser(tokenize(text), known, kind_of)
    run, kind = parser.whole()
    return Expression(text=text.strip(), mentions=tuple(parser.mentions), kind=kind, _run=run)


_Compiled = tuple[Evaluator, ValueKind | None]


class _Parser:
    """A Pratt parser over the tokens of one expression."""

    def __init__(
        self,
        tokens: list[Token],
        known: Callable[[str], bool] | None,
        kind_of: Callable[[str], ValueKind | None] | None,
    ) -> None:
        self.mentions: list[Mention] = []
        self._tokens = tokens
        self._known = known
        self._kind_of = kind_of
        self._next = 0
        self._depth = 0

    def whole(self) -> _Compiled:
        """Parse all tokens."""
        if self._tokens[0].kind is TokenKind.END:
            raise ExpressionError(
                "there is no condition", 1, "write one, for example scene.age >= 4"
            )
        compiled = self._expression(0)
        rest = self._tokens[self._next]
        if rest.kind is TokenKind.END:
            return compiled
        if rest.text == ")":
            raise ExpressionError("this ')' closes nothing", rest.column, "remove it")
        raise ExpressionError(
            f"an operator is expected before '{rest.text}'",
            rest.column,
            "join conditions with 'and' or 'or', and put texts in quotes",
        )

    def _take(self) -> Token:
        token = self._tokens[self._next]
        if token.kind is not TokenKind.END:
            self._next += 1
        return token

    def _expression(self, weakest: int) -> _Compiled:
        self._depth += 1
        column = self._tokens[self._next].column
        if self._depth > MAX_DEPTH:
            raise ExpressionError(
                f"the condition is nested more than {MAX_DEPTH} deep", column, "split it"
            )
        left = self._operand()
        while True:
            token = self._tokens[self._next]
            operator = BINARY.get(token.text) if token.kind is TokenKind.OPERATOR else None
            if operator is None or operator.strength <= weakest:
                break
            self._take()
            right = self._expression(operator.strength)
            left = self._applied(operator, token, left, right)
            self._refuse_chain(operator)
        self._depth -= 1
        return left

    def _applied(
        self, operator: Operator, token: Token, left: _Compiled, right: _Compiled
    ) -> _Compiled:
        problem = operator.problem(left[1], right[1])
        if problem:
            raise ExpressionError(problem, token.column)
        return operator.compile(left[0], right[0], token.column), operator.gives

    def _refuse_chain(self, operator: Operator) -> None:
        token = self._tokens[self._next]
        if operator.chains or token.kind is not TokenKind.OPERATOR:
            return
        following = BINARY.get(token.text)
        if following is not None and following.strength == operator.strength:
            raise ExpressionError(
                f"two comparisons in a row: '{token.text}' follows another one",
                token.column,
                "join them with and: 2 <= x and x <= 4",
            )

    def _operand(self) -> _Compiled:
        token = self._take()
        match token.kind:
            case TokenKind.NUMBER | TokenKind.TEXT | TokenKind.BOOLEAN:
                value = token.value
                return (lambda _: value), ValueKind.of(value)
            case TokenKind.NAME:
                return self._name(token)
            case TokenKind.OPERATOR if token.text in UNARY:
                operator = UNARY[token.text]
                operand = self._expression(operator.strength)
                problem = operator.problem(operand[1], operand[1])
                if problem:
                    raise ExpressionError(problem, token.column)
                return operator.compile(operand[0], operand[0], token.column), operator.gives
            case TokenKind.OPERATOR if token.text == "(":
                return self._parentheses(token)
        if token.kind is TokenKind.END:
            raise ExpressionError("the condition ends where a value is expected", token.column)
        raise ExpressionError(f"a value or name is expected, found '{token.text}'", token.column)

    def _name(self, token: Token) -> _Compiled:
        name = token.text
        if self._known is not None and not self._known(name):
            raise ExpressionError(f"there is no name '{name}' here", token.column)
        self.mentions.append(Mention(name=name, column=token.column))
        kind = self._kind_of(name) if self._kind_of is not None else None
        return (lambda lookup: lookup(name)), kind

    def _parentheses(self, opening: Token) -> _Compiled:
        inner = self._expression(0)
        closing = self._take()
        if closing.text != ")":
            if closing.kind is TokenKind.END:
                raise ExpressionError("this '(' is not closed", opening.column, "add a ')'")
            raise ExpressionError(
                f"an operator or ')' is expected before '{closing.text}'", closing.column
            )
        return inner
