# SPDX-License-Identifier: Apache-2.0
"""Functions of expressions: min, max, abs, round and len."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Context, Decimal

from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import (
    EvaluationError,
    Evaluator,
    Lookup,
    Part,
    ValueKind,
    a_number,
    bounded,
    described,
)

MAX_DIGITS = 15
"""Digits behind the point that ``round`` can keep; no number has more."""

_WHOLE_FROM = 2.0**53
"""Numbers from here on have no fraction."""

_EXACT = Context(prec=60)


@dataclass(frozen=True, kw_only=True)
class Function:
    """A function of at least one argument.

    Attributes:
        usage: How it is written, for messages.
        check_kinds: Refuses arguments whose kinds do not fit.
        compile: (arguments, column) → evaluator.
        most: Arguments that it takes at most.
    """

    name: str
    usage: str
    check_kinds: Callable[[Sequence[Part]], None]
    compile: Callable[[Sequence[Part], int], Evaluator]
    most: float = 1

    def check(self, arguments: Sequence[Part], column: int) -> None:
        """Refuse arguments whose number or kinds do not fit."""
        if not 1 <= len(arguments) <= self.most:
            count = f"{len(arguments)} values" if arguments else "nothing"
            message = f"'{self.name}' is given {count} in its parentheses"
            raise ExpressionError(message, column, f"write {self.usage}", len(self.name))
        self.check_kinds(arguments)


def _extreme(name: str, pick: Callable[[Iterable[float]], float]) -> Function:
    usage = f"{name}(a, b) or {name}([a, b, …])"

    def check(arguments: Sequence[Part]) -> None:
        if len(arguments) > 1:
            for argument in arguments:
                argument.must_be(ValueKind.NUMBER, f"'{name}' needs numbers")
            return
        (only,) = arguments
        only.must_be(
            ValueKind.LIST, f"'{name}' needs two numbers or more, or one list", f"write {usage}"
        )
        if only.items not in (None, ValueKind.NUMBER):
            raise only.error(f"'{name}' needs numbers, found a list of {only.items.many}")

    def compile_(arguments: Sequence[Part], column: int) -> Evaluator:
        runs = [argument.run for argument in arguments]
        if len(runs) > 1:
            return lambda lookup: _picked(pick, [run(lookup) for run in runs], name, column)
        (only,) = runs

        def run(lookup: Lookup) -> float:
            items = only(lookup)
            if not isinstance(items, (list, tuple)):
                raise EvaluationError(
                    f"'{name}' needs two numbers or more, or one list, found {described(items)}",
                    column,
                )
            return _picked(pick, items, name, column)

        return run

    return Function(name=name, usage=usage, check_kinds=check, compile=compile_, most=math.inf)


def _picked(
    pick: Callable[[Iterable[float]], float], items: Iterable[object], name: str, column: int
) -> float:
    # Endless is a fair reading of a range sensor; with "not a number" the order would decide.
    numbers = [_sound(a_number(item, name, column), name, column) for item in items]
    if not numbers:
        raise EvaluationError(f"'{name}' of an empty list", column)
    return bounded(pick(numbers), name, column)


def _sound(value: float, name: str, column: int) -> float:
    if value != value:
        raise EvaluationError(f"'{name}' needs numbers, found one that is not a number", column)
    return value


def _check_abs(arguments: Sequence[Part]) -> None:
    arguments[0].must_be(ValueKind.NUMBER, "'abs' needs a number")


def _compile_abs(arguments: Sequence[Part], column: int) -> Evaluator:
    of = arguments[0].run
    return lambda lookup: bounded(abs(a_number(of(lookup), "abs", column)), "abs", column)


def _check_round(arguments: Sequence[Part]) -> None:
    for argument in arguments:
        argument.must_be(ValueKind.NUMBER, "'round' needs numbers")
    if len(arguments) == 2 and arguments[1].constant is not None:
        problem = _digits_problem(arguments[1].constant)
        if problem:
            raise arguments[1].error(problem)


def _compile_round(arguments: Sequence[Part], column: int) -> Evaluator:
    value_of = arguments[0].run
    if len(arguments) == 1:
        return lambda lookup: rounded(_finite(value_of(lookup), column), 0)
    digits_of = arguments[1].run

    def run(lookup: Lookup) -> float:
        value = _finite(value_of(lookup), column)
        digits = a_number(digits_of(lookup), "round", column)
        problem = _digits_problem(digits)
        if problem:
            raise EvaluationError(problem, column)
        return rounded(value, int(digits))

    return run


def _finite(value: object, column: int) -> float:
    return bounded(a_number(value, "round", column), "round", column)


def rounded(value: float, digits: int) -> float:
    """Return a finite number rounded as at school: halves away from zero, 2.5 to 3.

    What counts is how it is written, so that 2.675 gives 2.68; 0 digits give a whole number.
    """
    if isinstance(value, int):
        return value
    if abs(value) >= _WHOLE_FROM:
        return value if digits else int(value)
    nearest = Decimal(repr(value)).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP, _EXACT)
    # Adding zero takes the sign from -0.0.
    return float(nearest) + 0.0 if digits else int(nearest)


def _digits_problem(digits: object) -> str:
    whole = isinstance(digits, (int, float)) and digits == digits // 1
    if whole and 0 <= digits <= MAX_DIGITS:  # type: ignore[operator]
        return ""
    return f"'round' keeps 0 to {MAX_DIGITS} digits, found {described(digits)}"


def _check_len(arguments: Sequence[Part]) -> None:
    (only,) = arguments
    if only.kind in (ValueKind.NUMBER, ValueKind.BOOLEAN):
        raise only.error(f"'len' needs a text or a list, found {only.kind.one}")


def _compile_len(arguments: Sequence[Part], column: int) -> Evaluator:
    of = arguments[0].run

    def run(lookup: Lookup) -> int:
        value = of(lookup)
        if not isinstance(value, (str, list, tuple)):
            raise EvaluationError(
                f"'len' needs a text or a list, found {described(value)}", column
            )
        return len(value)

    return run


FUNCTIONS: dict[str, Function] = {
    function.name: function
    for function in (
        _extreme("min", min),
        _extreme("max", max),
        Function(name="abs", usage="abs(x)", check_kinds=_check_abs, compile=_compile_abs),
        Function(
            name="round",
            usage="round(x) or round(x, 2) for two digits behind the point",
            check_kinds=_check_round,
            compile=_compile_round,
            most=2,
        ),
        Function(name="len", usage="len(x)", check_kinds=_check_len, compile=_compile_len),
    )
}
"""Every function; all of them give a number."""
