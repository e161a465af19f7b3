# SPDX-License-Identifier: Apache-2.0
"""Strategies that measure how far a bid is from the scene."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from marketplace_node.strategies.arrays import (
    Floats,
    LinearScores,
    RandomSource,
    RoundArrays,
    Scores,
    differences,
    mask_missing,
    scores_of,
    total,
)

_erf = np.vectorize(math.erf, otypes=[np.float64])


def manhattan(field: RoundArrays, options: Mapping[str, float], random: RandomSource) -> Scores:
    """Measure by the sum of ``|bid - scene|``, formula (1) of the paper, to the last digit.

    Missing values of the scene are skipped; without any value every distance is 0.
    """
    del options, random
    parts = differences(field)
    return scores_of(field, np.abs(parts, out=parts))


def manhattan_lines(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> LinearScores:
    """Return ``manhattan`` as a function of the scene."""
    del options, random
    count, width = field.bids.shape
    return LinearScores(profiles=field.bids, weights=np.ones(width), offsets=np.zeros(count))


def weighted_manhattan(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> Scores:
    """Measure by the sum of ``weight * |bid - scene|``; equals ``manhattan`` with weights of 1."""
    del options, random
    return scores_of(field, np.abs(differences(field)) * field.weights)


def weighted_lines(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> LinearScores:
    """Return ``weighted_manhattan`` as a function of the scene."""
    del options, random
    return LinearScores(
        profiles=field.bids, weights=field.weights, offsets=np.zeros(field.bids.shape[0])
    )


def euclidean(field: RoundArrays, options: Mapping[str, float], random: RandomSource) -> Scores:
    """Measure by the Euclidean distance, the root of the sum of ``(bid - scene)^2``.

    A parameter contributes its share of the length, ``(bid - scene)^2 / distance``, so that the
    contributions add up to the distance.
    """
    del options, random
    squares = differences(field) ** 2
    distance = np.broadcast_to(np.sqrt(total(squares)), field.shape)
    length = np.where(distance > 0.0, distance, 1.0)[..., None]
    return Scores(
        distance=distance,
        bonus=np.zeros(field.shape),
        score=distance,
        contributions=squares / length,
    )


def expected_manhattan(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> Scores:
    """Measure by the expected Manhattan distance when each value of the scene is Gaussian.

    With ``X ~ N(scene, std^2)`` and ``a = bid - scene``, it is the mean of the folded normal
    distribution: ``E|bid - X| = std sqrt(2/pi) exp(-a^2 / (2 std^2)) + a erf(a / (std sqrt 2))``
    (Leone, Nelson and Nottingham, 1961). Without any std it is ``manhattan`` to the last digit.
    """
    del options, random
    gap = differences(field)
    return scores_of(field, mask_missing(field, folded_mean(gap, field.std[..., None, :])))


def folded_mean(gap: Floats, std: Floats) -> Floats:
    """Return ``E|Y|`` of ``Y ~ N(gap, std^2)``; ``|gap|`` where std is 0, NaN or far smaller."""
    size = np.abs(gap)
    unsure = np.broadcast_to(std > 0.0, size.shape) & (size < 9.0 * std)
    if unsure.any():
        deviation = np.broadcast_to(std, size.shape)[unsure]
        turns = size[unsure] / deviation
        near = deviation * math.sqrt(2.0 / math.pi) * np.exp(-0.5 * turns**2)
        size[unsure] = near + size[unsure] * _erf(turns / math.sqrt(2.0))
    return size
