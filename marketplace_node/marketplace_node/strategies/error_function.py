# SPDX-License-Identifier: Apache-2.0
"""The error function of whole arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marketplace_node.strategies.arrays import Floats

_SMALL = 0.46875
_LARGE = 6.0
_NEAR = (
    (1.85777706184603153e-1, 3.16112374387056560e0, 1.13864154151050156e2,
     3.77485237685302021e2, 3.20937758913846947e3),
    (1.0, 2.36012909523441209e1, 2.44024637934444173e2, 1.28261652607737228e3,
     2.84423683343917062e3),
)  # fmt: skip
_MIDDLE = (
    (2.15311535474403846e-8, 5.64188496988670089e-1, 8.88314979438837594e0,
     6.61191906371416295e1, 2.98635138197400131e2, 8.81952221241769090e2,
     1.71204761263407058e3, 2.05107837782607147e3, 1.23033935479799725e3),
    (1.0, 1.57449261107098347e1, 1.17693950891312499e2, 5.37181101862009858e2,
     1.62138957456669019e3, 3.29079923573345963e3, 4.36261909014324716e3,
     3.43936767414372164e3, 1.23033935480374942e3),
)  # fmt: skip
"""Numerators and denominators, the highest power first."""


def erf(values: Floats) -> Floats:
    """Return the error function of numbers that are not negative.

    Rational approximations, one to 0.46875 and one from there on (Cody, Mathematics of Computation
    23, 1969); from 6 on it is 1. The error is below 1e-15.
    """
    result = np.ones_like(values)
    near = values <= _SMALL
    square = values[near] ** 2
    result[near] = values[near] * _ratio(_NEAR, square)
    middle = ~near & (values <= _LARGE)
    between = values[middle]
    result[middle] = 1.0 - np.exp(-(between**2)) * _ratio(_MIDDLE, between)
    return result


def _ratio(parts: tuple[Sequence[float], Sequence[float]], at: Floats) -> Floats:
    above, below = np.full_like(at, parts[0][0]), np.full_like(at, parts[1][0])
    for upper, lower in zip(parts[0][1:], parts[1][1:], strict=True):
        above *= at
        above += upper
        below *= at
        below += lower
    quotient: Floats = above / below
    return quotient
