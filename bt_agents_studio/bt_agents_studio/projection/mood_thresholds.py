# SPDX-License-Identifier: Apache-2.0
"""Mood thresholds: the change that makes a mood rule apply."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.expressions import parse_expression

_MOST_CONDITIONS = 1000
_LONGEST_CONDITION = 80
"""Maximum length of a condition whose thresholds are computed [characters]."""

_LARGEST_CHANGE = 1000.0
_HALVINGS = 32


@lru_cache(maxsize=_MOST_CONDITIONS)
def thresholds(when: str) -> tuple[float, ...]:
    """Return the smallest changes, downwards and upwards, that make a condition true.

    The result is empty if the condition depends on anything but the change.
    """
    if len(when) > _LONGEST_CONDITION:
        return ()
    try:
        condition = parse_expression(when)
    except ExpressionError:
        return ()
    if condition.names != {"mood.change"}:
        return ()

    def holds(change: float) -> bool:
        try:
            return condition.is_true(lambda _: change)
        except Undecided:
            return False

    if holds(0.0):
        return ()
    return tuple(
        _threshold(holds, far) for far in (-_LARGEST_CHANGE, _LARGEST_CHANGE) if holds(far)
    )


def _threshold(holds: Callable[[float], bool], far: float) -> float:
    """Return where a condition that is false at 0 and true far from it becomes true."""
    near = 0.0
    for _ in range(_HALVINGS):
        middle = (near + far) / 2
        near, far = (near, middle) if holds(middle) else (middle, far)
    return round(far, 5)
