# SPDX-License-Identifier: Apache-2.0
"""What the operators of a condition do with values, and which kinds of values they take."""

from __future__ import annotations

import math
import operator as python
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from bt_agents.language.expression_tokens import ExpressionError

Lookup = Callable[[str], object]
"""Returns the value of a name."""

Evaluator = Callable[[Lookup], object]
"""A compiled part of an expression."""


class EvaluationError(ExpressionError):
    """The values of an expression do not fit its operators."""


class ValueKind(Enum):
    """Kinds of values that operators tell apart."""

    NUMBER = "number"
    TEXT = "text"
    BOOLEAN = "true or false"

    @staticmethod
    def of(value: object) -> ValueKind | None:
        """Return the kind of a value; None for lists, mappings and nothing."""
        if isinstance(value, bool):
            return ValueKind.BOOLEAN
        if isinstance(value, (int, float)):
            return ValueKind.NUMBER
        return ValueKind.TEXT if isinstance(value, str) else None


@dataclass(frozen=True, kw_only=True)
class Operator:
    """One operator.

    Attributes:
        strength: Binds its operands the more tightly the larger it is.
        gives: Kind of its result.
        takes: Kind of both operands; None takes any kind, the same on both sides.
        compile: (left, right, column) → evaluator.
        word: As written, for messages.
        chains: Whether it may follow an operator of the same strength.
    """

    strength: int
    gives: ValueKind
    takes: ValueKind | None
    compile: Callable[[Evaluator, Evaluator, int], Evaluator]
    word: str
    chains: bool = True

    def problem(self, left: ValueKind | None, right: ValueKind | None) -> str:
        """Return why operands of these kinds do not fit, empty when they may; None is unknown."""
        if self.takes is None:
            if left is not None and right is not None and left is not right:
                return f"'{self.word}' cannot compare {_a(left)} with {_a(right)}"
            return ""
        for kind in (left, right):
            if kind is not None and kind is not self.takes:
                return f"'{self.word}' needs {_a(self.takes)} on each side, found {_a(kind)}"
        return ""


def _a(kind: ValueKind) -> str:
    return kind.value if kind is ValueKind.BOOLEAN else f"a {kind.value}"


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"the text '{value}'" if len(value) <= 40 else f"the text '{value[:39]}…'"
    if isinstance(value, (int, float)):
        return f"the number {value:g}" if isinstance(value, float) else f"the number {value}"[:60]
    return "nothing" if value is None else "a list or mapping"


def _arithmetic(word: str, strength: int, apply: Callable[[float, float], float]) -> Operator:
    def compile_(left: Evaluator, right: Evaluator, column: int) -> Evaluator:
        def run(lookup: Lookup) -> float:
            a = _number(left(lookup), word, column)
            b = _number(right(lookup), word, column)
            try:
                value = apply(a, b)
            except ZeroDivisionError:
                raise EvaluationError(f"'{word}' by zero", column) from None
            except OverflowError:
                value = math.inf
            if isinstance(value, float) and not math.isfinite(value):
                raise EvaluationError(f"the result of '{word}' is too large", column)
            return value

        return run

    number = ValueKind.NUMBER
    return Operator(strength=strength, gives=number, takes=number, compile=compile_, word=word)


def _order(word: str, apply: Callable[[float, float], bool]) -> Operator:
    def compile_(left: Evaluator, right: Evaluator, column: int) -> Evaluator:
        def run(lookup: Lookup) -> bool:
            a = left(lookup)
            b = right(lookup)
            # The usual case first: this line is most of what a tick spends on conditions.
            if type(a) is not float or type(b) is not float:
                a = _number(a, word, column)
                b = _number(b, word, column)
            return apply(a, b)

        return run

    return Operator(
        strength=4,
        gives=ValueKind.BOOLEAN,
        takes=ValueKind.NUMBER,
        compile=compile_,
        word=word,
        chains=False,
    )


def _equality(word: str, equal: bool) -> Operator:
    def compile_(left: Evaluator, right: Evaluator, column: int) -> Evaluator:
        def run(lookup: Lookup) -> bool:
            a, b = left(lookup), right(lookup)
            kind = ValueKind.of(a)
            if kind is None or kind is not ValueKind.of(b):
                raise EvaluationError(
                    f"'{word}' cannot compare {_shown(a)} with {_shown(b)}", column
                )
            return (a == b) is equal

        return run

    return Operator(
        strength=4,
        gives=ValueKind.BOOLEAN,
        takes=None,
        compile=compile_,
        word=word,
        chains=False,
    )


def _logic(word: str, strength: int, decided_by: bool) -> Operator:
    def compile_(left: Evaluator, right: Evaluator, column: int) -> Evaluator:
        def run(lookup: Lookup) -> bool:
            if _truth(left(lookup), word, column) is decided_by:
                return decided_by
            return _truth(right(lookup), word, column)

        return run

    kind = ValueKind.BOOLEAN
    return Operator(strength=strength, gives=kind, takes=kind, compile=compile_, word=word)


def _compile_not(operand: Evaluator, _: Evaluator, column: int) -> Evaluator:
    return lambda lookup: not _truth(operand(lookup), "not", column)


def _compile_minus(operand: Evaluator, _: Evaluator, column: int) -> Evaluator:
    return lambda lookup: -_number(operand(lookup), "-", column)


def _number(value: object, word: str, column: int) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise EvaluationError(f"'{word}' needs numbers, found {_shown(value)}", column)
    return value


def _truth(value: object, word: str, column: int) -> bool:
    if not isinstance(value, bool):
        raise EvaluationError(f"'{word}' needs true or false, found {_shown(value)}", column)
    return value


BINARY: dict[str, Operator] = {
    operator.word: operator
    for operator in (
        _logic("or", 1, decided_by=True),
        _logic("and", 2, decided_by=False),
        _equality("==", equal=True),
        _equality("!=", equal=False),
        _order("<", python.lt),
        _order("<=", python.le),
        _order(">", python.gt),
        _order(">=", python.ge),
        _arithmetic("+", 5, python.add),
        _arithmetic("-", 5, python.sub),
        _arithmetic("*", 6, python.mul),
        _arithmetic("/", 6, python.truediv),
        _arithmetic("%", 6, python.mod),
    )
}
"""Operators between two operands."""

UNARY: dict[str, Operator] = {
    "not": Operator(
        strength=3,
        gives=ValueKind.BOOLEAN,
        takes=ValueKind.BOOLEAN,
        compile=_compile_not,
        word="not",
    ),
    "-": Operator(
        strength=7,
        gives=ValueKind.NUMBER,
        takes=ValueKind.NUMBER,
        compile=_compile_minus,
        word="-",
    ),
}
"""Operators before one operand."""
