# SPDX-License-Identifier: Apache-2.0
"""Strategy: a function from the bids of one round to their scores, with its name and options."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, NoReturn, cast

import numpy as np
import numpy.typing as npt

from bt_agents_core.scene import Vector

TIE_BREAKS: Final = ("least_recently_run", "name")


class Bid(NamedTuple):
    """Bid of one agent.

    Attributes:
        profile: Value of each parameter.
        weights: Weight of each parameter.
        runs: How often the agent has run.
        last_run: Number of its last run; 0 if it never ran.
    """

    agent: str
    profile: Vector
    weights: Vector
    runs: int = 0
    last_run: int = 0


@dataclass(frozen=True, kw_only=True)
class RoundBids:
    """Bids of one round, with the scene that they are for.

    Attributes:
        scene: Value of each parameter, in its unit; NaN where missing.
        std: Standard deviation of each value; 0 where the value is certain.
        widths: Maximum minus minimum of each parameter.
        rounds: Number of runs of all agents.
        bids: The bids, sorted by the agents' names.
    """

    scene: Vector
    std: Vector
    widths: Vector
    rounds: int
    bids: Sequence[Bid]


class Score(NamedTuple):
    """Score of one bid; smaller is better.

    Attributes:
        distance: From the bid to the scene.
        bonus: What exploration subtracts from the distance; 0 without exploration.
        score: The ranked number.
        contributions: Contribution of each parameter to the distance; 0 where the value of the
            scene is missing.
    """

    distance: float
    bonus: float
    score: float
    contributions: Vector

    @classmethod
    def of(cls, contributions: Sequence[float]) -> Score:
        """Return the score of a strategy without exploration: the sum of the contributions."""
        distance = total(contributions)
        return cls(distance, 0.0, distance, tuple(contributions))

    def reduced(self, bonus: float) -> Score:
        """Return the score with an exploration bonus subtracted from the distance."""
        return self._replace(bonus=bonus, score=self.distance - bonus)


@dataclass(frozen=True, kw_only=True)
class Option:
    """Numeric option of a strategy.

    Attributes:
        name: Name in parameters and on the command line.
        default: Value if it is not set.
        description: Effect of the option in words, with its unit.
    """

    name: str
    default: float
    minimum: float
    maximum: float
    description: str


FloatArray = npt.NDArray[np.float64]

DifferenceFunction = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Values in profiles, values of scenes, weights → contributions of one parameter to distances."""


@dataclass(frozen=True, kw_only=True)
class StrategySpec:
    """Strategy with its name, function, options and properties.

    Attributes:
        name: Value of the parameter ``strategy``.
        description: Effect of the strategy, in one sentence.
        score: Returns one score per bid, in the order of the bids; a pure function of its
            arguments.
        options: Its options.
        draws: True if it uses the random source.
        counts: True if it uses the total number of runs.
        difference: For a score that is the sum of these contributions, less a bonus that no value
            of the scene changes: other scenes can then be ranked many at a time. None for others.
    """

    name: str
    description: str
    score: Callable[[RoundBids, Mapping[str, float], np.random.Generator], Sequence[Score]]
    options: tuple[Option, ...] = ()
    draws: bool = False
    counts: bool = False
    difference: DifferenceFunction | None = None

    def values(self, given: Mapping[str, float]) -> dict[str, float]:
        """Return the value of every option: the given one, else the default."""
        return {option.name: given.get(option.name, option.default) for option in self.options}

    def random(self, seed: str) -> np.random.Generator:
        """Return the random source of a round; without ``draws``, one that raises when used.

        NumPy loads its random sources, 6 MB, once something names them outside an annotation.
        """
        return round_rng(seed) if self.draws else cast("np.random.Generator", _Undeclared())


class _Undeclared:
    """Random source of a strategy without ``draws``."""

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"'random.{name}' needs draws=True in the entry of the strategy")


def round_rng(seed: str) -> np.random.Generator:
    """Return the random source of a round: PCG64, seeded with the SHA-256 of ``seed``.

    NumPy gets the digest as eight words of 32 bits, last word first.
    """
    words = np.frombuffer(hashlib.sha256(seed.encode()).digest()[::-1], dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words.astype(np.uint32))))


def total(parts: Sequence[float]) -> float:
    """Return the sum of the parts, added in order.

    The last digit decides ties, and ``sum`` rounds differently from one version of Python to the
    next.
    """
    added = 0.0
    for part in parts:
        added += part
    return added


def order(
    scores: Sequence[float], bids: Sequence[Bid], tie_break: str = TIE_BREAKS[0]
) -> list[int]:
    """Return the indices of bids, best first.

    Args:
        scores: Score of each bid; smaller is better.
        bids: The bids.
        tie_break: Order of equal scores: ``least_recently_run`` puts the bidder that ran least
            recently first, then sorts by name; ``name`` sorts by name alone.
    """
    by_name = tie_break == "name"
    keys = [
        (score, 0 if by_name else bid.last_run, bid.agent)
        for score, bid in zip(scores, bids, strict=True)
    ]
    return sorted(range(len(keys)), key=keys.__getitem__)


def winners(
    difference: DifferenceFunction,
    scenes: FloatArray,
    bids: Sequence[Bid],
    bonuses: Sequence[float],
    tie_break: str,
) -> list[int]:
    """Return the index of the winner for each of many scenes; a bid whose score is NaN loses.

    Args:
        difference: See :class:`StrategySpec`.
        scenes: A row per scene, a column per parameter; NaN where missing.
        bids: At least one.
        bonuses: What exploration subtracts from the distance of each bid.
        tie_break: As in :func:`order`.
    """
    # Columns are bids in the order of ties, of which argmin takes the first.
    columns = order([0.0] * len(bids), bids, tie_break)
    profiles = np.array([bids[column].profile for column in columns])
    weights = np.array([bids[column].weights for column in columns])
    distances = np.zeros((len(scenes), len(columns)))
    # In the order of a strategy's sum: the last digit decides ties.
    for values, profile, weight in zip(scenes.T, profiles.T, weights.T, strict=True):
        given = values[:, np.newaxis]
        distances += np.where(np.isnan(given), 0.0, difference(profile, given, weight))
    scores = distances - np.array([bonuses[column] for column in columns])
    best = np.argmin(np.where(np.isnan(scores), np.inf, scores), axis=1)
    return [columns[place] for place in best]
