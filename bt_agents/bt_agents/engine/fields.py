# SPDX-License-Identifier: Apache-2.0
"""Evaluates the fields of a node as the texts, times and counts that it needs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bt_agents.engine.scope import ValueSource, evaluate, explain_false
from bt_agents_core.errors import Refused
from bt_agents_core.field_types import Plain
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace, check_value
from bt_agents_language.expression.expression_values import described
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.specs import Literal, NodeSpec
from bt_agents_language.nodes.node_type import FOREVER


@dataclass(frozen=True, kw_only=True)
class NodeFields:
    """The fields of one node; each call evaluates them, because names change during a run."""

    spec: NodeSpec
    names: ValueSource

    def __contains__(self, name: str) -> bool:
        return name in self.spec.fields

    def value(self, name: str) -> Plain:
        """Return the current result of a value.

        Raises:
            MissingValue: A name in it has no value.
            EvaluationError: An expression in it cannot be evaluated.
        """
        value = self.spec.fields[name]
        assert not isinstance(value, Expression)
        return evaluate(value, self.names)

    def condition(self, name: str) -> Expression:
        """Return a condition."""
        value = self.spec.fields[name]
        assert isinstance(value, Expression)
        return value

    def is_true(self, name: str) -> bool:
        """Return whether a condition is true now; see :meth:`Expression.is_true`."""
        return self.condition(name).is_true(self.names.lookup)

    def explain_false(self, name: str, *, verb: str = "not so") -> str:
        """Return a text that a condition is not true, with the values of its names."""
        return explain_false(self.condition(name), self.names, verb=verb)

    def constant(self, name: str, default: Plain = None) -> Plain:
        """Return a constant value; ``default`` if the field is missing."""
        value = self.spec.fields.get(name)
        return value.value if isinstance(value, Literal) else default

    def number(self, name: str) -> float:
        """Return a finite number of at least 0.

        Raises:
            Refused: ``NOT_A_NUMBER`` unless it is finite and at least 0. Else as :meth:`value`.
        """
        return self._from_zero(name, RefusalCode.NOT_A_NUMBER, "a number from 0 on")

    def seconds(self, name: str) -> float:
        """Return a duration [s]; 0 if the field is missing.

        Raises:
            Refused: ``NOT_A_DURATION`` unless it is finite and at least 0. Else as
                :meth:`value`.
        """
        if name not in self.spec.fields:
            return 0.0
        return self._from_zero(name, RefusalCode.NOT_A_DURATION, "a time such as '5 s'")

    def count(self, name: str) -> int | None:
        """Return an integer of at least 1; None for ``forever``.

        Raises:
            Refused: ``NOT_A_COUNT``; it is neither. Else as :meth:`value`.
        """
        value = self.value(name) if name in self.spec.fields else FOREVER
        if value == FOREVER:
            return None
        number = finite(value)
        if number is None or number < 1 or not number.is_integer():
            raise Refused(
                RefusalCode.NOT_A_COUNT,
                f"'{name}' is {described(value)}, expected a whole number from 1 on",
            )
        return int(number)

    def _from_zero(self, name: str, code: RefusalCode, expected: str) -> float:
        value = self.value(name)
        number = finite(value)
        if number is None or number < 0:
            raise Refused(code, f"'{name}' is {described(value)}, expected {expected}")
        return number


def scene_value(space: SceneSpace, name: str, value: Plain, what: str) -> float:
    """Return a value for a scene parameter.

    Raises:
        Refused: ``UNKNOWN_PARAMETER``, ``NOT_A_NUMBER`` or ``OUT_OF_RANGE``.
    """
    parameter = space.parameter(name, what=what)
    number = finite(value)
    if number is None:
        raise Refused(
            RefusalCode.NOT_A_NUMBER,
            f"{what}: {name} is {described(value)}, expected a number between "
            f"{parameter.minimum:g} and {parameter.maximum:g}",
        )
    return check_value(parameter, number, what=what)


def finite(value: Plain) -> float | None:
    """Return the value if it is a finite number, else None."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
