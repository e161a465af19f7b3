# SPDX-License-Identifier: Apache-2.0
"""Piecewise linear scores: where along one parameter a bid is behind others."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from marketplace_node.strategies import LinearScores
from marketplace_node.strategies.arrays import Floats, Integers

_STRICTLY = 1e-9
"""By so much a score has to be less, where an equal one loses."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Intervals:
    """Intervals of one parameter; ``low[k] <= high[k]``."""

    low: Floats
    high: Floats

    def beyond(self, start: float, direction: float) -> float:
        """Return the first value, going up (1) or down (-1), in no stretch; perhaps infinite."""
        low, high = self.low, self.high
        if direction < 0:
            low, high = -high, -low
        at = direction * start
        by_low = np.argsort(low, kind="stable")
        low, reach = low[by_low], np.maximum.accumulate(high[by_low])
        begun = int(np.searchsorted(low, at, side="right"))
        if begun == 0 or reach[begun - 1] <= at:
            return start
        ends = np.append(low[1:] > reach[:-1], True)
        last = begun - 1 + int(np.argmax(ends[begun - 1 :]))
        return direction * float(reach[last])


def differences_between(lines: LinearScores, scene: Floats, one: int, others: Integers) -> Floats:
    """Return the score of one bid minus those of others, [K]; missing values do not count."""
    known = ~np.isnan(scene)
    rows = np.append(others, one)
    weights = np.broadcast_to(lines.weights, lines.profiles.shape)[rows][:, known]
    parts = weights * np.abs(lines.profiles[rows][:, known] - scene[known])
    scores = lines.offsets[rows] + parts.sum(axis=-1)
    gap: Floats = scores[-1] - scores[:-1]
    return gap


def losing_intervals(
    lines: LinearScores,
    scene: Floats,
    parameter: int,
    limits: tuple[float, float],
    one: int,
    others: Integers,
    loses_ties: Floats,
) -> Intervals:
    """Return where along a parameter one bid is behind one of the others.

    The score of one bid minus that of another is linear between the limits and the two profiles,
    so each of the three pieces holds at most one such stretch.

    Args:
        lines: The scores.
        scene: Values of the other parameters, [n].
        parameter: Index of the one that moves.
        limits: Its smallest and largest value; beyond them all is lost.
        one: Index of the bid.
        others: Indices of the others, [K].
        loses_ties: Whether the bid loses with an equal score, [K].
    """
    weights = np.broadcast_to(lines.weights, lines.profiles.shape)
    own_weight, own = weights[one, parameter], lines.profiles[one, parameter]
    weight, profile = weights[others, parameter], lines.profiles[others, parameter]

    def moved(at: Floats) -> Floats:
        part: Floats = own_weight * np.abs(own - at) - weight[:, None] * np.abs(
            profile[:, None] - at
        )
        return part

    here = moved(np.full((len(others), 1), scene[parameter]))
    base = differences_between(lines, scene, one, others)[:, None] - here
    bends = np.clip(np.stack([np.full_like(profile, own), profile], axis=1), *limits)
    bends.sort(axis=1)
    ends = np.full((len(others), 1), 1.0)
    at = np.concatenate([limits[0] * ends, bends, limits[1] * ends], axis=1)
    behind = base + moved(at) + np.where(loses_ties, _STRICTLY, 0.0)[:, None]
    left, right = at[:, :-1], at[:, 1:]
    at_left, at_right = behind[:, :-1], behind[:, 1:]
    rise = np.where(at_right == at_left, 1.0, at_right - at_left)
    root = np.clip(left - at_left * (right - left) / rise, left, right)
    lost_left, lost_right = at_left > 0.0, at_right > 0.0
    low = np.where(lost_left, left, root)
    high = np.where(lost_right, right, root)
    lost = lost_left | lost_right
    low[:, 0] = np.where(lost_left[:, 0], -math.inf, low[:, 0])
    high[:, -1] = np.where(lost_right[:, -1], math.inf, high[:, -1])
    outside_low = [-math.inf, math.nextafter(limits[1], math.inf)]
    outside_high = [math.nextafter(limits[0], -math.inf), math.inf]
    return Intervals(
        low=np.concatenate([low[lost], outside_low]),
        high=np.concatenate([high[lost], outside_high]),
    )
