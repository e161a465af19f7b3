# SPDX-License-Identifier: Apache-2.0
"""Strategies that explore: agents other than the nearest may win, so that none is starved."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from marketplace_node.strategies.arrays import (
    Floats,
    LinearScores,
    Option,
    RandomSource,
    RoundArrays,
    Scores,
    mask_missing,
    total,
    with_bonus,
)
from marketplace_node.strategies.distances import manhattan

TEMPERATURE = Option(
    name="temperature",
    default=0.5,
    minimum=0.001,
    maximum=100.0,
    description="how much chance counts; who is nearer by this is e times as likely",
)
EPSILON = Option(
    name="epsilon",
    default=0.1,
    minimum=0.0,
    maximum=1.0,
    description="share of the rounds whose order is left to chance alone",
)
UCB_C = Option(
    name="c",
    default=1.0,
    minimum=0.0,
    maximum=100.0,
    description="how much distance an agent is forgiven for having run seldom",
)
SIGMA = Option(
    name="sigma",
    default=0.1,
    minimum=0.0,
    maximum=10.0,
    description="how unsure the profile of an agent is that never ran, as a share of each range",
)

BOUNDED_C = Option(
    name="c",
    default=0.3,
    minimum=0.0,
    maximum=10.0,
    description="how much distance an agent is forgiven for having run seldom, as a share of the "
    "sum of all ranges",
)
MARGIN = Option(
    name="margin",
    default=0.3,
    minimum=0.0,
    maximum=1.0,
    description="nobody wins who is further than the nearest by more than this share of the sum "
    "of all ranges",
)

_LEAST = float(np.finfo(np.float64).tiny)


def softmax(field: RoundArrays, options: Mapping[str, float], random: RandomSource) -> Scores:
    """Draw the order with probabilities proportional to ``exp(-distance / temperature)``.

    It subtracts Gumbel noise times the temperature from the distance; the smallest result is
    distributed as the softmax (Gumbel, 1954).
    """
    even = np.maximum(random.random(field.shape), _LEAST)
    gumbel = -np.log(-np.log(even))
    return with_bonus(manhattan(field, options, random), options["temperature"] * gumbel)


def epsilon_greedy(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> Scores:
    """Rank by ``manhattan``, but with probability epsilon in random order.

    In a random order, the score is the place, from 0.
    """
    scores = manhattan(field, options, random)
    tickets = random.random((*field.shape[:-1], field.shape[-1] + 1))
    explores = tickets[..., :1] < options["epsilon"]
    places = np.argsort(np.argsort(tickets[..., 1:], axis=-1, kind="stable"), axis=-1)
    score = np.where(explores, places.astype(np.float64), scores.distance)
    bonus = np.where(explores, scores.distance - score, 0.0)
    return replace(scores, bonus=bonus, score=score)


def ucb(field: RoundArrays, options: Mapping[str, float], random: RandomSource) -> Scores:
    """Subtract ``c sqrt(ln(1 + t) / (1 + n))``: more for agents that ran less (n of t runs).

    After UCB1 (Auer, Cesa-Bianchi and Fischer, 2002).
    """
    return with_bonus(manhattan(field, options, random), options["c"] * _seldom(field))


def bounded_ucb(field: RoundArrays, options: Mapping[str, float], random: RandomSource) -> Scores:
    """Subtract the bonus of ``ucb``, but at most the margin.

    So no agent wins that is farther than the nearest by more than the margin. Both options are
    shares of the sum of the ranges of the parameters whose values are known.
    """
    c, margin = (
        ranges_share(field.scene, field.widths, options[name])[..., None]
        for name in ("c", "margin")
    )
    bonus = np.minimum(c * _seldom(field), margin)
    return with_bonus(manhattan(field, options, random), bonus)


def ranges_share(scene: Floats, widths: Floats, share: float) -> Floats:
    """Return a share of the sum of the ranges of all known parameters of scenes [..., n]."""
    return share * total(np.where(np.isnan(scene), 0.0, widths))


def thompson(field: RoundArrays, options: Mapping[str, float], random: RandomSource) -> Scores:
    """Measure the distance to a profile drawn from ``N(bid, (sigma * range / sqrt(1 + n))^2)``.

    The more often an agent ran (n), the more certain its profile is (Thompson, 1933).
    """
    scores = manhattan(field, options, random)
    gap = _drawn(field, options, random) - field.scene[..., None, :]
    drawn = total(mask_missing(field, np.abs(gap)))
    return replace(scores, bonus=scores.distance - drawn, score=drawn)


def softmax_lines(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> LinearScores:
    """Return ``softmax`` as a function of the scene."""
    return _less(field, softmax(field, options, random).bonus)


def ucb_lines(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> LinearScores:
    """Return ``ucb`` as a function of the scene."""
    return _less(field, ucb(field, options, random).bonus)


def bounded_ucb_lines(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> LinearScores:
    """Return ``bounded_ucb`` as a function of the scene."""
    return _less(field, bounded_ucb(field, options, random).bonus)


def epsilon_greedy_lines(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> LinearScores:
    """Return ``epsilon_greedy`` as a function of the scene; a random order ignores the scene."""
    scores = epsilon_greedy(field, options, random)
    width = field.bids.shape[-1]
    if np.array_equal(scores.score, scores.distance):
        return _less(field, np.zeros(field.shape))
    return LinearScores(profiles=field.bids, weights=np.zeros(width), offsets=scores.score)


def thompson_lines(
    field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> LinearScores:
    """Return ``thompson`` as a function of the scene."""
    drawn = _drawn(field, options, random)
    return LinearScores(
        profiles=drawn, weights=np.ones(drawn.shape[-1]), offsets=np.zeros(drawn.shape[0])
    )


def _seldom(field: RoundArrays) -> Floats:
    """Return ``sqrt(ln(1 + t) / (1 + n))`` of each bid, [..., N]."""
    # Logarithms of numpy depend on version and processor in the last digit; a replay must not.
    logarithms = np.vectorize(math.log1p, otypes=[np.float64])(field.rounds)
    bonus = np.sqrt(logarithms[..., None] / (1.0 + field.runs))
    return np.array(np.broadcast_to(bonus, field.shape))


def _less(field: RoundArrays, bonus: Floats) -> LinearScores:
    return LinearScores(profiles=field.bids, weights=np.ones(field.bids.shape[-1]), offsets=-bonus)


def _drawn(field: RoundArrays, options: Mapping[str, float], random: RandomSource) -> Floats:
    noise = random.standard_normal((*field.shape, field.bids.shape[-1]))
    spread = options["sigma"] * field.widths / np.sqrt(1.0 + field.runs)[..., None]
    profiles: Floats = field.bids + noise * spread
    return profiles
