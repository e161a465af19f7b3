# SPDX-License-Identifier: Apache-2.0
"""The rules by which the marketplace measures how well a bid suits a scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

from bt_agents.scene import Vector

Strategy = Callable[[Vector, Vector], float]
"""``(bid, scene) -> distance``: less is better; NaN in the scene marks a missing value."""


def manhattan(bid: Vector, scene: Vector) -> float:
    """Return the Manhattan distance, formula (1) of the paper: the sum of ``|bid - scene|``.

    A missing scene value is left out of the sum; without any scene value every distance is 0.
    The terms are added one by one in the order of the parameters, because ``sum`` rounds
    differently from Python 3.12 on and the last digit decides ties.

    Args:
        bid: One value a parameter, in the parameters' own units.
        scene: The same for the scene; NaN where missing.
    """
    distance = 0.0
    for offered, wanted in zip(bid, scene, strict=True):
        if not math.isnan(wanted):
            distance += abs(offered - wanted)
    return distance


STRATEGIES: Mapping[str, Strategy] = MappingProxyType({"manhattan": manhattan})
"""Every strategy by the name that the parameter ``strategy`` takes."""
