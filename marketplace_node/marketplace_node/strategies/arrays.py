# SPDX-License-Identifier: Apache-2.0
"""Arrays of rounds: input and output of strategies, the random source, the order."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

TIE_BREAKS: Final = ("least_recently_run", "name")


class RandomSource(Protocol):
    """Random source of a strategy; a ``numpy.random.Generator`` is one."""

    def random(self, size: tuple[int, ...], /) -> Floats:
        """Return uniform random numbers from 0 (included) to 1 (excluded)."""
        ...

    def standard_normal(self, size: tuple[int, ...], /) -> Floats:
        """Return random numbers of the standard normal distribution."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundArrays:
    """Bids of a round, or of many rounds along leading axes (written ``...``), as arrays.

    N is the number of bids, n the number of scene parameters. Leading axes of different
    attributes broadcast against each other as usual.

    Attributes:
        scene: Values of the scene in the units of the parameters, [..., n]; NaN where missing.
        std: Standard deviation of each value of the scene, [..., n]; NaN counts as 0.
        bids: Profiles of the bidders, [..., N, n].
        weights: Weight of each parameter, [..., N, n] or [n].
        widths: Maximum minus minimum of each parameter, [n].
        runs: Number of runs of each bidder, [..., N].
        rounds: Total number of runs, [...].
        idle: Number of runs of others since the bidder's last run, [..., N].
    """

    scene: Floats
    std: Floats
    bids: Floats
    weights: Floats
    widths: Floats
    runs: Floats
    rounds: Floats
    idle: Floats

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the scores, [..., N]."""
        return np.broadcast_shapes(
            self.bids.shape[:-1], (*self.scene.shape[:-1], 1), self.runs.shape
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Scores:
    """Scores of bids; smaller is better.

    Attributes:
        distance: From bid to scene, [..., N].
        bonus: What exploration subtracts from the distance, [..., N]; 0 without exploration.
        score: The ranked number, [..., N].
        contributions: Contribution of each parameter to the distance, [..., N, n]; 0 where the
            value of the scene is missing.
    """

    distance: Floats
    bonus: Floats
    score: Floats
    contributions: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearScores:
    """Scores that are ``offset + sum(weight * |profile - x|)`` of the scene x.

    Attributes:
        profiles: [N, n].
        weights: [N, n] or [n].
        offsets: Part of the score that does not depend on the scene, [N].
    """

    profiles: Floats
    weights: Floats
    offsets: Floats


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


Score = Callable[[RoundArrays, Mapping[str, float], RandomSource], Scores]


@dataclass(frozen=True, kw_only=True)
class StrategySpec:
    """Strategy with its name, function, options and properties.

    Attributes:
        name: Value of the parameter ``strategy``.
        description: Effect of the strategy, in one sentence.
        score: Scores all bids; a pure function of its arguments.
        options: Its options.
        draws: True if it uses the random source.
        counts: True if it uses the total number of runs.
        lines: Returns the scores of one round as a piecewise linear function of the scene, which
            makes the smallest change of a scene exact; None if they are not piecewise linear.
    """

    name: str
    description: str
    score: Score
    options: tuple[Option, ...] = ()
    draws: bool = False
    counts: bool = False
    lines: Callable[[RoundArrays, Mapping[str, float], RandomSource], LinearScores] | None = None

    def values(self, given: Mapping[str, float]) -> dict[str, float]:
        """Return the value of every option: the given one, else the default."""
        return {option.name: given.get(option.name, option.default) for option in self.options}


def round_rng(seed: str) -> np.random.Generator:
    """Return the random source of a round: PCG64, seeded with the SHA-256 of ``seed``.

    NumPy gets the digest as eight words of 32 bits, last word first.
    """
    words = np.frombuffer(hashlib.sha256(seed.encode()).digest()[::-1], dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words.astype(np.uint32))))


class BatchRandomSource:
    """Random source of many rounds at once; each round draws what it would draw alone.

    There is one source for each round along the first axis.
    """

    def __init__(self, sources: list[np.random.Generator]) -> None:
        self._sources = sources

    def random(self, size: tuple[int, ...], /) -> Floats:
        return np.stack([source.random(size[1:]) for source in self._sources])

    def standard_normal(self, size: tuple[int, ...], /) -> Floats:
        return np.stack([source.standard_normal(size[1:]) for source in self._sources])


def total(parts: Floats) -> Floats:
    """Return sums over the last axis, [..., n] to [...], added in order.

    Each sum equals that of a plain loop bit for bit. ``np.sum`` adds pairwise, and the last digit
    decides ties.
    """
    added: Any = np.zeros(parts.shape[:-1])
    for index in range(parts.shape[-1]):
        added += parts[..., index]
    return np.asarray(added)


def differences(field: RoundArrays) -> Floats:
    """Return bid minus scene, [..., N, n]; 0 where the value of the scene is missing."""
    gap: Floats = field.bids - field.scene[..., None, :]
    return mask_missing(field, gap)


def mask_missing(field: RoundArrays, parts: Floats) -> Floats:
    """Set parts [..., N, n] to 0 in place where the value of the scene is missing."""
    missing = np.isnan(field.scene)
    if missing.any():
        np.copyto(parts, 0.0, where=missing[..., None, :])
    return parts


def scores_of(field: RoundArrays, contributions: Floats) -> Scores:
    """Return the scores of a strategy without exploration; the distance sums ``contributions``."""
    distance = np.broadcast_to(total(contributions), field.shape)
    return Scores(
        distance=distance, bonus=np.zeros(field.shape), score=distance, contributions=contributions
    )


def with_bonus(scores: Scores, bonus: Floats) -> Scores:
    """Return the scores with an exploration bonus subtracted."""
    return replace(scores, bonus=bonus, score=scores.distance - bonus)


def order(
    scores: Floats,
    last_run: Any,
    names: Sequence[str] | None,
    tie_break: str = "least_recently_run",
) -> Integers:
    """Return the indices of bids, best first.

    Args:
        scores: Scores, [..., N]; smaller is better.
        last_run: Number of the last run of each bidder, [..., N] or [N]; 0 when it never ran.
        names: Unique name of each bidder, N; None when the bidders are sorted by name.
        tie_break: Order of equal scores: ``least_recently_run`` puts the bidder that ran least
            recently first, then sorts by name; ``name`` sorts by name alone.

    Returns:
        Indices along the last axis, [..., N].
    """
    keys: list[Any] = [scores]
    if tie_break == "least_recently_run":
        keys.insert(0, np.broadcast_to(np.asarray(last_run), scores.shape))
    if names is not None:
        by_name = np.empty(len(names), dtype=np.int64)
        by_name[sorted(range(len(names)), key=names.__getitem__)] = np.arange(len(names))
        keys.insert(0, np.broadcast_to(by_name, scores.shape))
    return np.lexsort(keys, axis=-1)  # stable: equal keys keep their order
