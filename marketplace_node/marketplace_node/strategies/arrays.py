# SPDX-License-Identifier: Apache-2.0
"""Arrays of rounds: what strategies take and return, the random source, the order."""

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
        """Return numbers drawn evenly from 0 (included) to 1 (excluded)."""
        ...

    def standard_normal(self, size: tuple[int, ...], /) -> Floats:
        """Return numbers drawn from the normal distribution of mean 0 and deviation 1."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundArrays:
    """Bids of a round, or of many rounds along leading axes (written ``...``), as arrays.

    N is the number of bids and n that of the scene parameters. Leading axes of different
    attributes broadcast against each other as usual.

    Attributes:
        scene: Shape [..., n]; NaN where missing; in the units of the parameters.
        std: Standard deviation of each value of the scene, [..., n]; NaN counts as 0.
        bids: [..., N, n].
        weights: How much each parameter counts, [..., N, n] or [n].
        widths: Maximum minus minimum of each parameter, [n].
        runs: How often each bidder has run, [..., N].
        rounds: How many runs there have been in all, [...].
        idle: How many runs of others there have been since the last own one, [..., N].
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
        """Shape of every score, [..., N]."""
        return np.broadcast_shapes(
            self.bids.shape[:-1], (*self.scene.shape[:-1], 1), self.runs.shape
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Scores:
    """Scores of bids; less is better.

    Attributes:
        distance: From bid to scene, [..., N].
        bonus: What exploration takes off the distance, [..., N]; 0 without exploration.
        score: What is ranked, [..., N].
        contributions: What each parameter adds to the distance, [..., N, n]; 0 where the value of
            the scene is missing.
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
        offsets: What does not depend on the scene, [N].
    """

    profiles: Floats
    weights: Floats
    offsets: Floats


@dataclass(frozen=True, kw_only=True)
class Option:
    """Option of a strategy, a number.

    Attributes:
        name: As in parameters and on the command line.
        default: Value unless it is set.
        description: What it does, in words, with its unit.
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
        name: As the parameter ``strategy`` takes it.
        description: What it does, in one sentence.
        score: Measures all bids; pure: what it gives depends on its arguments alone.
        options: What can be set about it.
        draws: True when it draws chance.
        counts: True when it looks at how many runs there have been in all.
        lines: The same for one round as a function of the scene, where it is made of straight
            lines; lets the smallest change of a scene be found exactly. None elsewhere.
    """

    name: str
    description: str
    score: Score
    options: tuple[Option, ...] = ()
    draws: bool = False
    counts: bool = False
    lines: Callable[[RoundArrays, Mapping[str, float], RandomSource], LinearScores] | None = None

    def values(self, given: Mapping[str, float]) -> dict[str, float]:
        """Return the value of every option: as given, else the default."""
        return {option.name: given.get(option.name, option.default) for option in self.options}


def round_rng(seed: str) -> np.random.Generator:
    """Return the source of chance of a round: PCG64, seeded by the SHA-256 of ``seed``.

    NumPy takes the digest as eight words of 32 bits, the last of them first.
    """
    words = np.frombuffer(hashlib.sha256(seed.encode()).digest()[::-1], dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words.astype(np.uint32))))


class BatchRandomSource:
    """Random source of many rounds at once, each of which draws what it would draw alone.

    There is one source for each round along the first axis.
    """

    def __init__(self, sources: list[np.random.Generator]) -> None:
        self._sources = sources

    def random(self, size: tuple[int, ...], /) -> Floats:
        return np.stack([source.random(size[1:]) for source in self._sources])

    def standard_normal(self, size: tuple[int, ...], /) -> Floats:
        return np.stack([source.standard_normal(size[1:]) for source in self._sources])


def total(parts: Floats) -> Floats:
    """Return sums over the last axis, [..., n] to [...], added one by one in order.

    So each sum is bit for bit that of a plain loop; ``np.sum`` adds pairwise, and the last digit
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
    """Return the scores of a strategy without exploration, whose distance is the sum of parts."""
    distance = np.broadcast_to(total(contributions), field.shape)
    return Scores(
        distance=distance, bonus=np.zeros(field.shape), score=distance, contributions=contributions
    )


def with_bonus(scores: Scores, bonus: Floats) -> Scores:
    """Return the scores with an exploration bonus taken off."""
    return replace(scores, bonus=bonus, score=scores.distance - bonus)


def order(
    scores: Floats,
    last_run: Any,
    names: Sequence[str] | None,
    tie_break: str = "least_recently_run",
) -> Integers:
    """Return the indices of bids, best first.

    Args:
        scores: [..., N]; smaller is better.
        last_run: Number of the last run of each bidder, [..., N] or [N]; 0 when it never ran.
        names: Name of each bidder, N; no two alike. None when they stand in the order of their
            names.
        tie_break: ``least_recently_run``: of equal scores the one that ran least recently comes
            first, then by name; ``name``: by name alone.

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
    return np.lexsort(keys, axis=-1)  # stable: what is equal stays as it stands
