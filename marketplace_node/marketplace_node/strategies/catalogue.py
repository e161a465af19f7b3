# SPDX-License-Identifier: Apache-2.0
"""All strategies: what each computes for a bid p and the scene x, and its name and options.

A parameter whose value of the scene is missing contributes 0; without any value every distance
is 0. Some strategies explore: agents other than the nearest may win, so that none is starved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from bt_agents_core.scene import Vector
from marketplace_node.strategies.strategy import (
    Bid,
    FloatArray,
    Option,
    RoundBids,
    Score,
    StrategySpec,
    total,
)

_LEAST = float(np.finfo(np.float64).tiny)


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


_OWN = (
    StrategySpec(
        name="manhattan",
        description="The nearest bid by the sum of the differences wins, as in the paper.",
        score=manhattan,
        difference=difference,
    ),
    StrategySpec(
        name="weighted_manhattan",
        description="Like manhattan, with a weight for each parameter.",
        score=weighted_manhattan,
        difference=weighted_difference,
    ),
    StrategySpec(
        name="euclidean",
        description="The nearest bid by straight-line distance wins; one big difference counts "
        "more than several small ones.",
        score=euclidean,
    ),
    StrategySpec(
        name="expected_manhattan",
        description="Like manhattan, but an uncertain value of the scene counts less.",
        score=expected_manhattan,
    ),
    StrategySpec(
        name="softmax",
        description="Nearer bids are more likely to win, but every bid has a chance.",
        score=softmax,
        options=(
            Option(
                name="temperature",
                default=0.5,
                minimum=0.001,
                maximum=100.0,
                description="weight of chance; an agent nearer by this distance is e times as "
                "likely to win",
            ),
        ),
        draws=True,
        difference=difference,
    ),
    StrategySpec(
        name="epsilon_greedy",
        description="The nearest bid wins, except in a share of the rounds with a random order.",
        score=epsilon_greedy,
        options=(
            Option(
                name="epsilon",
                default=0.1,
                minimum=0.0,
                maximum=1.0,
                description="share of the rounds with a random order",
            ),
        ),
        draws=True,
    ),
    StrategySpec(
        name="ucb",
        description="The nearest bid wins, after a bonus for agents that seldom ran.",
        score=ucb,
        options=(
            Option(
                name="c",
                default=1.0,
                minimum=0.0,
                maximum=100.0,
                description="size of the distance bonus for an agent that seldom ran",
            ),
        ),
        counts=True,
        difference=difference,
    ),
    StrategySpec(
        name="bounded_ucb",
        description="Like ucb, but an agent much farther away than the nearest cannot win.",
        score=bounded_ucb,
        options=(
            Option(
                name="c",
                default=0.3,
                minimum=0.0,
                maximum=10.0,
                description="size of the distance bonus for an agent that seldom ran, as a share "
                "of the sum of all ranges",
            ),
            Option(
                name="margin",
                default=0.3,
                minimum=0.0,
                maximum=1.0,
                description="an agent farther away than the nearest by more than this share of "
                "the sum of all ranges cannot win",
            ),
        ),
        counts=True,
        difference=difference,
    ),
    StrategySpec(
        name="thompson",
        description="The nearest of randomly drawn profiles wins; they vary more for agents that "
        "seldom ran.",
        score=thompson,
        options=(
            Option(
                name="sigma",
                default=0.1,
                minimum=0.0,
                maximum=10.0,
                description="standard deviation of the profile of an agent that never ran, as a "
                "share of each range",
            ),
        ),
        draws=True,
    ),
    StrategySpec(
        name="rules",
        description="The first rule of market.yaml that applies names the winner; manhattan ranks "
        "the other agents.",
        score=manhattan,
    ),
    StrategySpec(
        name="external",
        description="An external program ranks through the service 'bt_agents/select'; without "
        "an answer in time, manhattan does.",
        score=manhattan,
        options=(
            Option(
                name="limit",
                default=0.5,
                minimum=0.05,
                maximum=60.0,
                description="longest time for its answer [s]",
            ),
        ),
    ),
)

_ALL = {spec.name: spec for spec in _OWN}

STRATEGIES: Mapping[str, StrategySpec] = MappingProxyType(_ALL)
"""All strategies; the keys are the values of the parameter ``strategy``."""


def add(spec: StrategySpec) -> None:
    """Add a strategy, unless its name is taken."""
    _ALL.setdefault(spec.name, spec)
