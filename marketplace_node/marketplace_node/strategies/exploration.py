# SPDX-License-Identifier: Apache-2.0
"""Strategies that explore: agents other than the nearest may win, so that none is starved."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bt_agents_core.scene import Vector
from marketplace_node.strategies.distances import differences, manhattan
from marketplace_node.strategies.strategy import Bid, Option, RoundBids, Score, total

TEMPERATURE = Option(
    name="temperature",
    default=0.5,
    minimum=0.001,
    maximum=100.0,
    description="weight of chance; an agent nearer by this distance is e times as likely to win",
)
EPSILON = Option(
    name="epsilon",
    default=0.1,
    minimum=0.0,
    maximum=1.0,
    description="share of the rounds with a random order",
)
UCB_C = Option(
    name="c",
    default=1.0,
    minimum=0.0,
    maximum=100.0,
    description="size of the distance bonus for an agent that seldom ran",
)
SIGMA = Option(
    name="sigma",
    default=0.1,
    minimum=0.0,
    maximum=10.0,
    description="standard deviation of the profile of an agent that never ran, as a share of each "
    "range",
)

BOUNDED_C = Option(
    name="c",
    default=0.3,
    minimum=0.0,
    maximum=10.0,
    description="size of the distance bonus for an agent that seldom ran, as a share of the "
    "sum of all ranges",
)
MARGIN = Option(
    name="margin",
    default=0.3,
    minimum=0.0,
    maximum=1.0,
    description="an agent farther away than the nearest by more than this share of the sum of all "
    "ranges cannot win",
)

_LEAST = float(np.finfo(np.float64).tiny)


def softmax(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Draw the order with probabilities proportional to ``exp(-distance / temperature)``.

    It subtracts Gumbel noise times the temperature from the distance; the smallest result is
    distributed as the softmax (Gumbel, 1954).
    """
    temperature = options["temperature"]
    return [
        score.reduced(temperature * -math.log(-math.log(max(random.random(), _LEAST))))
        for score in manhattan(given, options, random)
    ]


def epsilon_greedy(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Rank by ``manhattan``, but with probability epsilon in random order.

    In a random order, the score is the place, from 0.
    """
    scores = manhattan(given, options, random)
    if random.random() >= options["epsilon"]:
        return scores
    tickets = [random.random() for _ in scores]
    for place, index in enumerate(sorted(range(len(scores)), key=tickets.__getitem__)):
        distance = scores[index].distance
        scores[index] = scores[index]._replace(bonus=distance - place, score=float(place))
    return scores


def ucb(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Subtract ``c √(ln(1 + t) / (1 + n))``: more for agents that ran less (n of t runs).

    After UCB1 (Auer, Cesa-Bianchi and Fischer, 2002).
    """
    return [
        score.reduced(options["c"] * _seldom(bid, given.rounds))
        for bid, score in zip(given.bids, manhattan(given, options, random), strict=True)
    ]


def bounded_ucb(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Subtract the bonus of ``ucb``, but at most the margin.

    So no agent wins that is farther than the nearest by more than the margin. Both options are
    shares of the sum of the ranges of the parameters whose values are known.
    """
    c, margin = (
        ranges_share(given.scene, given.widths, options[name]) for name in ("c", "margin")
    )
    return [
        score.reduced(min(c * _seldom(bid, given.rounds), margin))
        for bid, score in zip(given.bids, manhattan(given, options, random), strict=True)
    ]


def thompson(
    given: RoundBids, options: Mapping[str, float], random: np.random.Generator
) -> list[Score]:
    """Measure the distance to a profile drawn from ``N(p, (sigma * range / √(1 + n))²)``.

    The more often an agent ran (n), the more certain its profile is (Thompson, 1933).
    """
    scores = []
    for bid, score in zip(given.bids, manhattan(given, options, random), strict=True):
        certain = math.sqrt(1.0 + bid.runs)
        noise = random.standard_normal(len(bid.profile)).tolist()
        drawn = tuple(
            p + z * (options["sigma"] * width / certain)
            for p, z, width in zip(bid.profile, noise, given.widths, strict=True)
        )
        distance = total(differences(drawn, given.scene))
        scores.append(score._replace(bonus=score.distance - distance, score=distance))
    return scores


def ranges_share(scene: Vector, widths: Vector, share: float) -> float:
    """Return a share of the sum of the ranges of all parameters whose values are known."""
    known = [0.0 if math.isnan(x) else width for x, width in zip(scene, widths, strict=True)]
    return share * total(known)


def _seldom(bid: Bid, rounds: int) -> float:
    """Return ``√(ln(1 + t) / (1 + n))``."""
    return math.sqrt(math.log1p(rounds) / (1.0 + bid.runs))
