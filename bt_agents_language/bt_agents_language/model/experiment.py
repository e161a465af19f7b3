# SPDX-License-Identifier: Apache-2.0
"""Experiments of the paper as data: seeded scenes, prepared feedback, expected profiles."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from bt_agents_core.scene import SceneSpace, Vector


@dataclass(frozen=True, kw_only=True)
class FeedbackErrors:
    """Errors in prepared feedback: which of it is wrong, and its wrong value.

    Attributes:
        every: Every n-th feedback is wrong; 0 if chance decides.
        share: Probability that a feedback is wrong, 0..1; 0 when ``every`` decides.
        value: The wrong vector; None draws each value uniformly from the range of its parameter.
    """

    space: SceneSpace
    seed: int
    every: int = 0
    share: float = 0.0
    value: Vector | None = None

    def instead(self, index: int) -> Vector | None:
        """Return the wrong vector for the feedback with an index, from 0; None if it is right.

        It depends only on seed and index, so a restart changes nothing.
        """
        if self.every and (index + 1) % self.every:
            return None
        chance = random.Random(f"{self.seed}/{index}")
        if not self.every and chance.random() >= self.share:
            return None
        if self.value is not None:
            return self.value
        return tuple(chance.uniform(p.minimum, p.maximum) for p in self.space.parameters)


@dataclass(frozen=True, kw_only=True)
class PreparedFeedback:
    """Feedback that a simulated person gives after each run.

    Attributes:
        each: Agent → its feedback after every run.
        sequences: Agent → vectors that its own runs use up in order; it gets no others.
        sequence: Vectors used up in order by all other agents together.
        repeat: True starts each sequence again after its end.
        errors: Errors in the feedback; None for none.
    """

    each: Mapping[str, Vector] = field(default_factory=dict)
    sequences: Mapping[str, tuple[Vector, ...]] = field(default_factory=dict)
    sequence: tuple[Vector, ...] = ()
    repeat: bool = False
    errors: FeedbackErrors | None = None

    def is_wrong(self, index: int) -> bool:
        """Return whether the feedback of an index, from 0, is wrong."""
        return self.errors is not None and self.errors.instead(index) is not None


@dataclass(frozen=True, kw_only=True)
class ExperimentSpec:
    """Content of an ``experiment.yaml``; ``seed`` draws the scene of each round."""

    title: str
    rounds: int
    seed: int
    scenes: tuple[Vector, ...]
    feedback: PreparedFeedback

    def order(self) -> tuple[Vector, ...]:
        """Return the scene of every round, drawn at random with the seed."""
        draw = random.Random(self.seed)
        return tuple(draw.choice(self.scenes) for _ in range(self.rounds))

    def shortened(self, rounds: int) -> ExperimentSpec:
        """Return the experiment with another number of rounds; the first ones are equal."""
        return replace(self, rounds=rounds)


@dataclass(frozen=True, kw_only=True)
class FeedbackRecord:
    """Observed round: the winner, and its profile before and after the feedback."""

    round: int
    scene: Vector
    winner: str
    before: Vector
    after: Vector


def closed_form(
    start: Sequence[float], target: Sequence[float], rate: float, cycles: int
) -> Vector:
    """Return the profile after equal feedback: ``p_n = f + (p_0 − f)(1 − η)^n``.

    The solution of the paper's update ``p ← p + η (f − p)`` for a constant ``f``: ``start`` is
    ``p_0``, ``target`` ``f``, ``rate`` ``η``, and ``cycles`` ``n``.
    """
    keep = (1.0 - rate) ** cycles
    return tuple(f + (p - f) * keep for p, f in zip(start, target, strict=True))


def deviation(
    records: Iterable[FeedbackRecord],
    targets: Mapping[str, Sequence[float]],
    starts: Mapping[str, Sequence[float]],
    rates: Mapping[str, float],
) -> float:
    """Return the largest difference of a recorded profile from the closed form, round by round.

    Each agent has a constant feedback (target), a profile before the first round (start) and a
    learning rate; the records are in the order of the rounds.
    """
    cycles = dict.fromkeys(targets, 0)
    largest = 0.0
    for record in records:
        agent = record.winner
        for profile, count in ((record.before, cycles[agent]), (record.after, cycles[agent] + 1)):
            expected = closed_form(starts[agent], targets[agent], rates[agent], count)
            differences = (abs(a - b) for a, b in zip(profile, expected, strict=True))
            largest = max(largest, *differences)
        cycles[agent] += 1
    return largest


def difference(one: Sequence[FeedbackRecord], other: Sequence[FeedbackRecord]) -> float:
    """Return the largest difference between two recordings of the same experiment.

    It is infinite if they differ in more than the values of profiles.
    """
    if [(r.scene, r.winner) for r in one] != [(r.scene, r.winner) for r in other]:
        return math.inf
    return max(
        (
            abs(a - b)
            for mine, yours in zip(one, other, strict=True)
            for a, b in zip(mine.before + mine.after, yours.before + yours.after, strict=True)
        ),
        default=0.0,
    )
