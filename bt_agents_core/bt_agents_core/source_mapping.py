# SPDX-License-Identifier: Apache-2.0
"""Linear mapping between readings of a source and values of its scene parameter.

Points are (reading, value) pairs with rising readings; without points, a reading is the value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

Points = Sequence[tuple[float, float]]


def mapped(points: Points, reading: float) -> float:
    """Return the value of a reading: linear between the points, constant beyond them."""
    if not points:
        return reading
    if reading <= points[0][0]:
        return points[0][1]
    for (x0, y0), (x1, y1) in pairwise(points):
        if reading <= x1:
            return y0 + (y1 - y0) * (reading - x0) / (x1 - x0)
    return points[-1][1]


def mapped_std(points: Points, reading: float, std: float) -> float:
    """Return the standard deviation of the value of an uncertain reading.

    It maps the readings one deviation below and above, and takes the deviation of their values
    from the value itself: the sigma points of S. Julier and J. Uhlmann, "A New Extension of the
    Kalman Filter to Nonlinear Systems", 1997, in one dimension. On a straight piece of the map
    this is exactly the deviation times the slope. Beyond an end of the map it is the deviation at
    the end: a value that is held there is not known exactly.
    """
    if points:
        reading = min(max(reading, points[0][0]), points[-1][0])
    middle = mapped(points, reading)
    sides = (mapped(points, reading - std), mapped(points, reading + std))
    return math.sqrt(math.fsum((side - middle) ** 2 for side in sides) / 2.0)


def inverted(points: Points, value: float) -> float:
    """Return a reading that maps to a value, as closely as the points allow."""
    if not points:
        return value
    for (x0, y0), (x1, y1) in pairwise(points):
        if min(y0, y1) <= value <= max(y0, y1):
            return x0 if y0 == y1 else x0 + (x1 - x0) * (value - y0) / (y1 - y0)
    return min(points, key=lambda point: abs(point[1] - value))[0]
