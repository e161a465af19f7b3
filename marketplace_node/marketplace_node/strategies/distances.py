# SPDX-License-Identifier: Apache-2.0
"""Strategies that measure how far each bid p is from the scene x.

A parameter whose value of the scene is missing contributes 0; without any value every distance
is 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bt_agents_core.scene import Vector
from marketplace_node.strategies.strategy import FloatArray, RoundBids, Score, total


def manhattan(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Measure by ``Σ |p - x|``, formula (1) of the paper."""
    del options, random
    return [Score.of(differences(bid.profile, given.scene)) for bid in given.bids]


def difference(profiles: FloatArray, values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return ``|p - x|`` of one parameter."""
    del weights
    return np.abs(profiles - values)


def weighted_difference(
    profiles: FloatArray, values: FloatArray, weights: FloatArray
) -> FloatArray:
    """Return ``w |p - x|`` of one parameter."""
    return np.abs(profiles - values) * weights


def differences(profile: Vector, scene: Vector) -> list[float]:
    """Return ``|p - x|`` of each parameter."""
    return [0.0 if math.isnan(x) else abs(p - x) for p, x in zip(profile, scene, strict=True)]


def weighted_manhattan(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Measure by ``Σ w |p - x|``; equals ``manhattan`` with weights of 1."""
    del options, random
    return [
        Score.of(
            [
                d * w
                for d, w in zip(differences(bid.profile, given.scene), bid.weights, strict=True)
            ]
        )
        for bid in given.bids
    ]


def euclidean(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Measure by the Euclidean distance, ``√ Σ (p - x)²``.

    A parameter contributes its share of the length, ``(p - x)² / distance``, so that the
    contributions add up to the distance.
    """
    del options, random
    scores = []
    for bid in given.bids:
        squares = [d * d for d in differences(bid.profile, given.scene)]
        distance = math.sqrt(total(squares))
        shares = tuple(square / (distance or 1.0) for square in squares)
        scores.append(Score(distance, 0.0, distance, shares))
    return scores


def expected_manhattan(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Measure by the expected Manhattan distance when each value of the scene is Gaussian.

    Without any standard deviation it is ``manhattan`` to the last digit.
    """
    del options, random
    return [
        Score.of(
            [
                0.0 if math.isnan(x) else folded_mean(p - x, std)
                for p, x, std in zip(bid.profile, given.scene, given.std, strict=True)
            ]
        )
        for bid in given.bids
    ]


def folded_mean(gap: float, std: float) -> float:
    """Return ``E|Y|`` of ``Y ~ N(gap, std²)``; ``|gap|`` where std is 0 or far smaller.

    It is the mean of the folded normal distribution:
    ``std √(2/π) exp(-gap² / (2 std²)) + gap erf(gap / (std √2))`` (Leone, Nelson and Nottingham,
    1961).
    """
    size = abs(gap)
    if not size < 9.0 * std:  # also where std is NaN
        return size
    turns = size / std
    near = std * math.sqrt(2.0 / math.pi) * math.exp(-0.5 * (turns * turns))
    return near + size * math.erf(turns / math.sqrt(2.0))
