# SPDX-License-Identifier: Apache-2.0
"""Dimension checks of expressions: a time and a length are never added or compared."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_language.expression.expression_values import Part
from bt_agents_language.expression.units import Dimension

_ADDING = ("+", "-", "%")
_COMPARING = ("==", "!=", "<", "<=", ">", ">=")
_KEEPING = ("min", "max", "abs", "round")


def unit_of_pair(word: str, left: Part, right: Part) -> Dimension | None:
    """Return the dimension of what an operator gives; None for a plain number, or no number.

    A plain number fits every dimension: it is in SI units.

    Raises:
        ExpressionError: The operands have dimensions that do not go together.
    """
    if word in _ADDING:
        return _same(word, (left, right))
    if word in _COMPARING:
        _same(word, (left, right))
        return None
    units = [part.unit for part in (left, right) if part.unit is not None]
    if word == "*" and len(units) == 2:
        raise right.error(f"'*' cannot multiply {units[0].a} by {units[1].a}")
    if word in ("*", "/") and len(units) == 1:
        # A number by a time is no quantity that a field could take.
        return left.unit if word == "/" else units[0]
    return None


def unit_of_call(name: str, arguments: Sequence[Part]) -> Dimension | None:
    """Return the dimension of what a function gives; as :func:`unit_of_pair`."""
    if name not in _KEEPING:
        return None
    return _same(name, arguments[:1] if name == "round" else arguments)


def check_range_units(value: Part, low: Part, high: Part) -> None:
    """Refuse a range of another dimension than the value that may lie in it.

    Raises:
        ExpressionError: As said.
    """
    _same("between", (value, low, high))


def _same(word: str, parts: Sequence[Part]) -> Dimension | None:
    first: Dimension | None = None
    for part in parts:
        if part.unit is None:
            continue
        if first is not None and part.unit is not first:
            raise part.error(f"'{word}' cannot take {first.a} and {part.unit.a} together")
        first = part.unit
    return first
