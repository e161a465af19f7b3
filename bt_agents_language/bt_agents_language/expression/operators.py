# SPDX-License-Identifier: Apache-2.0
"""Operators of expressions: their meaning, precedence and operand types."""

from __future__ import annotations

import math
import operator as python
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from bt_agents_core.text import folded
from bt_agents_language.expression.expression_hints import ABSENT, ABSENT_HINT, label_hint
from bt_agents_language.expression.expression_values import (
    EvaluationError,
    Evaluator,
    Lookup,
    NoValue,
    Part,
    ValueKind,
    a_number,
    a_truth,
    bounded,
    described,
)

COMPARISON = 4
"""Strength of comparisons, such as ``==``, ``<``, ``in`` and ``between``."""

HOUR = "clock.hour"
"""Name of the hour, which wraps around."""

_NUMBER_HINT = "the number in a text is number(…)"
_JOIN_HINT = 'texts are not joined here; write them one after the other: "${a} ${b}"'


@dataclass(frozen=True, kw_only=True)
class Operator:
    """Operator between two operands.

    Attributes:
        check: Refuses operands of wrong kinds.
        compile: (left, right, column) → evaluator.
        strength: Precedence; larger values bind tighter.
        gives: Kind of its result; None for the common kind of its operands.
        replaces_missing: Whether its left operand may be without a value.
    """

    word: str
    check: Callable[[Part, Part], None]
    compile: Callable[[Part, Part, int], Evaluator]
    strength: int = COMPARISON
    gives: ValueKind | None = ValueKind.BOOLEAN
    replaces_missing: bool = False

    @property
    def chains(self) -> bool:
        """Whether the operator may follow another of the same strength."""
        return self.strength != COMPARISON


@dataclass(frozen=True, kw_only=True)
class Prefix:
    """Operator before one operand; attributes as in :class:`Operator`."""

    word: str
    strength: int
    gives: ValueKind
    compile: Callable[[Part, int], Evaluator]

    def check(self, operand: Part) -> None:
        """Refuse an operand of a wrong kind."""
        operand.must_be(self.gives, f"'{self.word}' needs {self.gives.one}")


def _both(kind: ValueKind, word: str, hint: str = "") -> Callable[[Part, Part], None]:
    needs = f"'{word}' needs {kind.one} on each side"

    def check(left: Part, right: Part) -> None:
        for part in (left, right):
            if part.kind is not kind:
                fits = kind is ValueKind.BOOLEAN or part.kind is ValueKind.TEXT
                part.must_be(kind, needs, hint if fits else "")

    return check


def _arithmetic(word: str, strength: int, apply: Callable[[float, float], float]) -> Operator:
    def compile_(left: Part, right: Part, column: int) -> Evaluator:
        a_of, b_of = left.run, right.run

        def run(lookup: Lookup) -> float:
            a = a_number(a_of(lookup), word, column)
            b = a_number(b_of(lookup), word, column)
            try:
                value = apply(a, b)
            except ZeroDivisionError:
                raise EvaluationError(f"'{word}' by zero", column) from None
            except OverflowError:
                value = math.inf
            return bounded(value, word, column)

        return run

    number = ValueKind.NUMBER
    check = _both(number, word, _JOIN_HINT if word == "+" else _NUMBER_HINT)
    return Operator(word=word, check=check, compile=compile_, strength=strength, gives=number)


def _order(word: str, apply: Callable[[float, float], bool]) -> Operator:
    def compile_(left: Part, right: Part, column: int) -> Evaluator:
        a_of, b_of, limit = left.run, right.run, right.constant
        if isinstance(limit, (int, float)):

            def against(lookup: Lookup) -> bool:
                a = a_of(lookup)
                # The usual case comes first: conditions spend most of their time on this line.
                if type(a) is not float and type(a) is not int:
                    a = a_number(a, word, column)
                return apply(a, limit)

            return against

        def run(lookup: Lookup) -> bool:
            a = a_of(lookup)
            b = b_of(lookup)
            if type(a) is not float or type(b) is not float:
                a = a_number(a, word, column)
                b = a_number(b, word, column)
            return apply(a, b)

        return run

    check = _both(ValueKind.NUMBER, word, _NUMBER_HINT)
    return Operator(word=word, check=check, compile=compile_)


def _equality(word: str, equal: bool) -> Operator:
    def check(left: Part, right: Part) -> None:
        for part in (left, right):
            if part.kind is ValueKind.LIST:
                wanted = f"write {'in' if equal else 'not in'} instead of {word}"
                raise part.error(f"'{word}' cannot compare with a list", wanted)
        if left.kind is not None and right.kind is not None and left.kind is not right.kind:
            raise right.error(
                f"'{word}' cannot compare {left.kind.one} with {right.kind.one}",
                _quotes_hint(left, word, right),
            )
        left.refuse_other_words(right)
        right.refuse_other_words(left)

    def compile_(left: Part, right: Part, column: int) -> Evaluator:
        a_of, b_of, wanted = left.run, right.run, right.constant
        if wanted is not None:
            wanted_kind, sought = ValueKind.of(wanted), _compared(wanted)

            def against(lookup: Lookup) -> bool:
                a = a_of(lookup)
                if ValueKind.of(a) is not wanted_kind:
                    raise _incomparable(word, a, wanted, column)
                return (_compared(a) == sought) is equal

            return against

        def run(lookup: Lookup) -> bool:
            a, b = a_of(lookup), b_of(lookup)
            kind = ValueKind.of(a)
            if kind is None or kind is ValueKind.LIST or kind is not ValueKind.of(b):
                raise _incomparable(word, a, b, column)
            return (_compared(a) == _compared(b)) is equal

        return run

    return Operator(word=word, check=check, compile=compile_)


def _compared(value: object) -> object:
    """Return a value for comparison: case and Unicode encoding of texts do not matter."""
    return folded(value) if isinstance(value, str) else value


def _incomparable(word: str, one: object, other: object, column: int) -> EvaluationError:
    message = f"'{word}' cannot compare {described(one)} with {described(other)}"
    return EvaluationError(message, column)


def _quotes_hint(left: Part, word: str, right: Part) -> str:
    """Return how to fix a comparison with a text, mostly by quoting it."""
    for part, other in ((left, right), (right, left)):
        value = part.constant
        if isinstance(value, str) and value in ABSENT:
            return ABSENT_HINT
        if isinstance(value, str) and other.labels:
            return label_hint(other.name, word, value)
        if isinstance(value, str):
            number = other.kind is ValueKind.NUMBER and value.replace(".", "", 1).isdecimal()
            if number or (other.kind is ValueKind.BOOLEAN and value in ("true", "false")):
                return f"remove the quotation marks: {value}"
        elif value is not None and other.kind is ValueKind.BOOLEAN:
            return "compare with true or false, or write only the name"
        elif value is not None and other.kind is ValueKind.TEXT:
            text = str(value).lower() if isinstance(value, bool) else f"{value:g}"
            return f"compare a text with a text in quotation marks, such as '{text}'"
    return ""


def _membership(word: str, inside: bool) -> Operator:
    def check(left: Part, right: Part) -> None:
        if left.kind is ValueKind.LIST:
            raise left.error(f"'{word}' looks for one value, found a list")
        if right.kind is ValueKind.TEXT:
            left.must_be(ValueKind.TEXT, f"'{word}' looks for a text in a text")
        elif right.kind is ValueKind.LIST:
            if right.items is not None:
                quotes = ValueKind.TEXT in (left.kind, right.items)
                left.must_be(
                    right.items,
                    f"the list after '{word}' holds {right.items.many}",
                    "texts stand in quotation marks, numbers without" if quotes else "",
                )
        elif right.kind is not None:
            raise right.error(
                f"'{word}' needs a list or a text after it, found {right.kind.one}",
                f"write {word} [ … ]; for a range of numbers: between 2 and 4",
            )
        if right.members:
            left.refuse_other_words(right)

    def compile_(left: Part, right: Part, column: int) -> Evaluator:
        wanted_of, where_of = left.run, right.run

        def run(lookup: Lookup) -> bool:
            wanted, where = wanted_of(lookup), where_of(lookup)
            if isinstance(where, str):
                if not isinstance(wanted, str):
                    raise EvaluationError(
                        f"'{word}' looks for a text in a text, found {described(wanted)}", column
                    )
                return (folded(wanted) in folded(where)) is inside
            if not isinstance(where, (list, tuple)):
                raise EvaluationError(
                    f"'{word}' needs a list or a text after it, found {described(where)}", column
                )
            return _among(wanted, where, word, column) is inside

        return run

    return Operator(word=word, check=check, compile=compile_)


def _among(wanted: object, items: Iterable[object], word: str, column: int) -> bool:
    """Return whether a value is one of some values; ``true`` is not ``1`` here."""
    kind = ValueKind.of(wanted)
    if kind is None or kind is ValueKind.LIST:
        raise EvaluationError(f"'{word}' looks for one value, found {described(wanted)}", column)
    sought = _compared(wanted)
    for item in items:
        if ValueKind.of(item) is not kind:
            raise _incomparable(word, wanted, item, column)
        if _compared(item) == sought:
            return True
    return False


def _logic(word: str, strength: int, decided_by: bool) -> Operator:
    def compile_(left: Part, right: Part, column: int) -> Evaluator:
        a_of, b_of = left.run, right.run

        def run(lookup: Lookup) -> bool:
            if a_truth(a_of(lookup), word, column) is decided_by:
                return decided_by
            return a_truth(b_of(lookup), word, column)

        return run

    hint = f"write a comparison on each side: x == 4 {word} x == 5"
    check = _both(ValueKind.BOOLEAN, word, hint)
    return Operator(word=word, check=check, compile=compile_, strength=strength)


def _check_else(left: Part, right: Part) -> None:
    if left.constant is not None:
        raise left.error(
            "what stands before 'else' always has a value",
            "put a comparison before it in parentheses: (x > 1) else false",
        )
    if left.kind is not None:
        right.must_be(left.kind, f"'else' needs {left.kind.one} in place of a missing one")


def _compile_else(left: Part, right: Part, _: int) -> Evaluator:
    value_of, default_of = left.run, right.run

    def run(lookup: Lookup) -> object:
        try:
            return value_of(lookup)
        except NoValue:
            return default_of(lookup)

    return run


def check_between(value: Part, low: Part, high: Part) -> None:
    """Check the operands of ``between``.

    Raises:
        ExpressionError: They are not numbers, or the range is empty.
    """
    for part in (value, low, high):
        text = part.kind is ValueKind.TEXT
        hint = "look for a text with in ['a', 'b']" if text else ""
        part.must_be(ValueKind.NUMBER, "'between' needs numbers", hint)
    first, last = low.constant, high.constant
    if isinstance(first, (int, float)) and isinstance(last, (int, float)) and first > last:
        raise low.error(
            f"nothing lies between {first} and {last}, the first number must be the smaller one",
            f"write {value.name} >= {first} or {value.name} < {last}"
            if value.name == HOUR
            else f"write between {last} and {first}",
        )


def compile_between(value: Part, low: Part, high: Part, column: int) -> Evaluator:
    """Return the evaluator of ``value between low and high``, which includes both ends."""
    value_of, low_of, high_of = value.run, low.run, high.run

    def run(lookup: Lookup) -> bool:
        between = a_number(value_of(lookup), "between", column)
        lowest = a_number(low_of(lookup), "between", column)
        return lowest <= between <= a_number(high_of(lookup), "between", column)

    return run


def _compile_not(operand: Part, column: int) -> Evaluator:
    of = operand.run
    return lambda lookup: not a_truth(of(lookup), "not", column)


def _compile_minus(operand: Part, column: int) -> Evaluator:
    of = operand.run
    return lambda lookup: bounded(-a_number(of(lookup), "-", column), "-", column)


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
        _membership("in", inside=True),
        _membership("not in", inside=False),
        _arithmetic("+", 5, python.add),
        _arithmetic("-", 5, python.sub),
        _arithmetic("*", 6, python.mul),
        _arithmetic("/", 6, python.truediv),
        _arithmetic("%", 6, python.mod),
        Operator(
            word="else",
            check=_check_else,
            compile=_compile_else,
            strength=8,
            gives=None,
            replaces_missing=True,
        ),
    )
}
"""Operators between two operands; ``between … and …`` has three, and its own rule."""

PREFIXES: dict[str, Prefix] = {
    "not": Prefix(word="not", strength=3, gives=ValueKind.BOOLEAN, compile=_compile_not),
    "-": Prefix(word="-", strength=7, gives=ValueKind.NUMBER, compile=_compile_minus),
}
"""Operators before one operand."""
