# SPDX-License-Identifier: Apache-2.0
"""Kinds of values in expressions, compiled parts, and checks of their types and dimensions."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.scene import Labels
from bt_agents_core.text import ellipsize, folded
from bt_agents_language.expression.conditions import Condition
from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.ranges import Range
from bt_agents_language.expression.units import Dimension

Lookup = Callable[[str], object]
"""Function that returns the value of a name."""

Evaluator = Callable[[Lookup], object]
"""Compiled part of an expression."""

ANY_LABELS: Labels = ((0.0, ""),)
"""Labels of a name that may belong to any scene parameter."""

LARGEST = sys.float_info.max
"""Largest absolute value that an expression computes."""

_LARGEST_SHOWN = 10**18


class EvaluationError(ExpressionError):
    """Values of an expression that do not fit its operators and functions."""


class NoValue(BtAgentsError):
    """Missing value of a part of an expression; ``else`` replaces it, ``known`` tests for it."""


class Undecided(EvaluationError):
    """Condition that is neither true nor false, for another reason than a missing value."""


class ValueKind(Enum):
    """Kinds of values that operators and functions distinguish."""

    NUMBER = "number"
    TEXT = "text"
    BOOLEAN = "true or false"
    LIST = "list"

    @staticmethod
    def of(value: object) -> ValueKind | None:
        """Return the kind of a value; None for mappings and None."""
        if isinstance(value, bool):
            return ValueKind.BOOLEAN
        if isinstance(value, (int, float)):
            return ValueKind.NUMBER
        if isinstance(value, str):
            return ValueKind.TEXT
        return ValueKind.LIST if isinstance(value, (list, tuple)) else None

    @property
    def one(self) -> str:
        """One value of this kind in words: ``a number``."""
        return self.value if self is ValueKind.BOOLEAN else f"a {self.value}"

    @property
    def many(self) -> str:
        """Several values of this kind in words: ``numbers``."""
        return self.value if self is ValueKind.BOOLEAN else f"{self.value}s"


@dataclass(kw_only=True, slots=True, eq=False)
class Part:
    """A part of an expression, compiled.

    Attributes:
        kind: Kind of its value; None if it is known only at run time.
        column: Start of its first word, from 1.
        items: Kind of the items of a literal list; None otherwise.
        constant: Value of a literal number, text or boolean; None otherwise.
        unit: Dimension of a quantity; None for plain numbers and everything else.
        words: The only texts that it can be; empty for any.
        members: Parts of a literal list.
        range: Range of its value, as far as known.
        labels: Words for values of a scene parameter; None for anything else.
        name: The name, if it is a name; empty otherwise.
        condition: Condition on names that are compared with constants; None for none.
        operator: Its outermost operator or function, ``[`` for a list; empty for a name or value.
        operands: What that stands between, before or around.
    """

    run: Evaluator
    kind: ValueKind | None
    column: int
    width: int
    items: ValueKind | None = None
    constant: bool | int | float | str | None = None
    unit: Dimension | None = None
    words: tuple[str, ...] = ()
    members: Sequence[Part] = ()
    range: Range | None = None
    labels: Labels | None = None
    name: str = ""
    condition: Condition | None = None
    operator: str = ""
    operands: tuple[Part, ...] = ()

    def must_be(self, kind: ValueKind, needs: str, hint: str = "") -> None:
        """Refuse the part if its value is definitely of another kind.

        Raises:
            ExpressionError: It is; ``needs`` states the requirement: ``'<' needs numbers``.
        """
        if self.kind is not None and self.kind is not kind:
            raise self.error(f"{needs}, found {self.kind.one}", hint)

    def refuse_other_words(self, other: Part) -> None:
        """Refuse a text, or a text in a list, that this part can never equal.

        Raises:
            ExpressionError: It is not one of its ``words``.
        """
        words = [*map(folded, self.words)]
        for one in other.members or (other,):
            if words and isinstance(one.constant, str) and folded(one.constant) not in words:
                raise one.error(
                    f"it is never '{ellipsize(one.constant)}'",
                    f"write one of {', '.join(self.words)}",
                )

    def error(self, message: str, hint: str = "") -> ExpressionError:
        """Return an error at the part."""
        return ExpressionError(message, self.column, hint, self.width)


def a_number(value: object, word: str, column: int) -> float:
    """Return the number that an operator or function needs.

    Raises:
        EvaluationError: It is none.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise EvaluationError(f"'{word}' needs numbers, found {described(value)}", column)
    return value


def a_truth(value: object, word: str, column: int) -> bool:
    """Return the boolean that an operator needs.

    Raises:
        EvaluationError: It is neither.
    """
    if not isinstance(value, bool):
        raise EvaluationError(f"'{word}' needs true or false, found {described(value)}", column)
    return value


def bounded(value: float, word: str, column: int) -> float:
    """Return the number that results from an operator or function.

    Raises:
        EvaluationError: It is too large, or not a number.
    """
    if -LARGEST <= value <= LARGEST:
        return value
    if value != value:
        raise EvaluationError(f"the result of '{word}' is not a number", column)
    raise EvaluationError(f"the result of '{word}' is too large", column)


def described(value: object) -> str:
    """Return a value in words for a message."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"the text '{ellipsize(value)}'"
    if isinstance(value, float):
        return f"the number {value:g}"
    if isinstance(value, int):
        large = not -_LARGEST_SHOWN < value < _LARGEST_SHOWN
        return "a very large number" if large else f"the number {value}"
    if value is None:
        return "nothing"
    return "a list" if isinstance(value, (list, tuple)) else "a mapping"


def unit_of_pair(word: str, left: Part, right: Part) -> Dimension | None:
    """Return the dimension of an operator's result; None for a plain number, or no number.

    A plain number fits every dimension: it is in SI units.

    Raises:
        ExpressionError: The operands have incompatible dimensions.
    """
    if word in ("+", "-", "%", "else"):
        return common_unit(word, (left, right))
    if word in ("==", "!=", "<", "<=", ">", ">="):
        common_unit(word, (left, right))
        return None
    units = [part.unit for part in (left, right) if part.unit is not None]
    if word == "*" and len(units) == 2:
        raise right.error(f"'*' cannot multiply {units[0].a} by {units[1].a}")
    if word in ("*", "/") and len(units) == 1:
        # No field takes a number divided by a time.
        return left.unit if word == "/" else units[0]
    return None


def unit_of_call(name: str, arguments: Sequence[Part]) -> Dimension | None:
    """Return the dimension of a function's result, like :func:`unit_of_pair`."""
    if name not in ("min", "max", "abs", "round"):
        return None
    return common_unit(name, arguments[:1] if name == "round" else arguments)


def common_unit(word: str, parts: Sequence[Part]) -> Dimension | None:
    """Return the common dimension of the parts, like :func:`unit_of_pair`."""
    first: Dimension | None = None
    for part in parts:
        if part.unit is None:
            continue
        if first is not None and part.unit is not first:
            raise part.error(f"'{word}' cannot take {first.a} and {part.unit.a} together")
        first = part.unit
    return first


def common_kind(one: Part, other: Part) -> ValueKind | None:
    """Return the common kind of both parts; None if they differ or it is not known yet."""
    return one.kind if one.kind is other.kind else None
