# SPDX-License-Identifier: Apache-2.0
"""Ranges of expressions, as far as the ranges of their names determine them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple


class Range(NamedTuple):
    """Range of numbers; for conditions, false counts as 0 and true as 1."""

    low: float
    high: float

    @property
    def settled(self) -> bool:
        """Whether the range has only one value."""
        return self.low == self.high


FALSE, TRUE, EITHER = Range(0, 0), Range(1, 1), Range(0, 1)

Known = Range | None
"""Range; None if unknown, or if the value is neither a number nor a condition."""


def of_constant(value: object) -> Known:
    """Return the range of a literal value."""
    return Range(value, value) if isinstance(value, bool | int | float) else None


def of_pair(word: str, left: Known, right: Known) -> Known:
    """Return the range of the result of an operator between two operands."""
    if word in _LOGIC:
        return _LOGIC[word](left or EITHER, right or EITHER)
    combine = _PAIRS.get(word)
    return None if combine is None or left is None or right is None else combine(left, right)


def of_prefix(word: str, operand: Known) -> Known:
    """Return the range of the result of an operator before one operand."""
    if operand is None:
        return None
    if word == "not":
        return Range(1 - operand.high, 1 - operand.low)
    return Range(-operand.high, -operand.low)


def of_between(value: Known, low: Known, high: Known) -> Known:
    """Return the range of ``value between low and high``."""
    return of_pair("and", of_pair(">=", value, low), of_pair("<=", value, high))


def of_call(name: str, arguments: Sequence[Known]) -> Known:
    """Return the range of a function's result; a list argument has the range of its items."""
    ranges = [one for one in arguments if one is not None]
    if not ranges or len(ranges) < len(arguments):
        return None
    first = ranges[0]
    if name == "abs":
        ends = sorted((abs(first.low), abs(first.high)))
        return Range(0 if first.low <= 0 <= first.high else ends[0], ends[1])
    pick = {"min": min, "max": max}.get(name)
    if pick is None:
        return None
    return Range(pick(one.low for one in ranges), pick(one.high for one in ranges))


def of_list(items: Sequence[Known]) -> Known:
    """Return the common range of all items of a list."""
    ranges = [one for one in items if one is not None]
    if not ranges or len(ranges) < len(items):
        return None
    return Range(min(one.low for one in ranges), max(one.high for one in ranges))


def _less(left: Range, right: Range) -> Range:
    if left.high < right.low:
        return TRUE
    return FALSE if left.low >= right.high else EITHER


def _at_most(left: Range, right: Range) -> Range:
    if left.high <= right.low:
        return TRUE
    return FALSE if left.low > right.high else EITHER


def _equal(left: Range, right: Range) -> Range:
    if left.settled and left == right:
        return TRUE
    return _among(left, right)


def _among(left: Range, right: Range) -> Range:
    return FALSE if left.high < right.low or right.high < left.low else EITHER


def _inverse(of: Callable[[Range, Range], Range]) -> Callable[[Range, Range], Known]:
    return lambda left, right: of_prefix("not", of(left, right))


def _corners(of: Callable[[float, float], float]) -> Callable[[Range, Range], Known]:
    """Return the range of an operator whose extremes are at the extremes of its operands."""

    def combine(left: Range, right: Range) -> Known:
        return _hull(of(a, b) for a in left for b in right)

    return combine


def _divided(left: Range, right: Range) -> Known:
    if right.low <= 0 <= right.high:
        return None
    return _hull(a / b for a in left for b in right)


def _hull(values: Iterable[float]) -> Known:
    found = [*values]
    return Range(min(found), max(found)) if all(map(math.isfinite, found)) else None


_LOGIC: Mapping[str, Callable[[Range, Range], Range]] = {
    "and": lambda a, b: Range(min(a.low, b.low), min(a.high, b.high)),
    "or": lambda a, b: Range(max(a.low, b.low), max(a.high, b.high)),
}

_PAIRS: Mapping[str, Callable[[Range, Range], Known]] = {
    "<": _less,
    "<=": _at_most,
    ">": lambda left, right: _less(right, left),
    ">=": lambda left, right: _at_most(right, left),
    "==": _equal,
    "!=": _inverse(_equal),
    "in": _among,
    "not in": _inverse(_among),
    "+": _corners(lambda a, b: a + b),
    "-": _corners(lambda a, b: a - b),
    "*": _corners(lambda a, b: a * b),
    "/": _divided,
}
