# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments as data: the seeded order of scenes, what each profile must become."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from bt_agents_core.scene import Vector
from feedback_node.simulated_feedback import SimulatedFeedback


@dataclass(frozen=True, kw_only=True)
class ExperimentSpec:
    """An ``experiment.yaml``.

    Attributes:
        title: For people.
        rounds: How many scenes are put on the market.
        seed: Seed of their order.
        scenes: The scenes that are drawn from.
        feedback: What the simulated person says after each run.
    """

    title: str
    rounds: int
    seed: int
    scenes: tuple[Vector, ...]
    feedback: SimulatedFeedback

    def order(self) -> tuple[Vector, ...]:
        """Return the scene of every round, drawn at random with the seed."""
        draw = random.Random(self.seed)
        return tuple(draw.choice(self.scenes) for _ in range(self.rounds))

    def shortened(self, rounds: int) -> ExperimentSpec:
        """Return the same experiment with another number of rounds; the first ones are equal."""
        return replace(self, rounds=rounds)


@dataclass(frozen=True, kw_only=True)
class FeedbackRecord:
    """One round as it was observed: who won, and its profile before and after the feedback."""

    round: int
    scene: Vector
    winner: str
    before: Vector
    after: Vector


def closed_form(
    start: Sequence[float], target: Sequence[float], rate: float, cycles: int
) -> Vector:
    """Return the profile after equal feedback: ``p_n = f + (p_0 − f)(1 − η)^n``.

    The solution of the paper's update ``p ← p + η (f − p)`` for a constant ``f``.

    Args:
        start: Profile before the first feedback.
        target: The feedback ``f``.
        rate: Learning rate ``η``.
        cycles: Number of times ``n`` the feedback was given.
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

    Args:
        records: In the order of the rounds.
        targets: Agent → its constant feedback.
        starts: Agent → its profile before the first round.
        rates: Agent → its learning rate.
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

    It is infinite when they differ in more than the values of profiles.
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
