# SPDX-License-Identifier: Apache-2.0
"""Common random numbers for paired comparison: all randomness of many runs, one seed per run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from bt_agents_core.scene import Vector
from bt_agents_lab.experiments.simulated_world import Floats, Integers, SimulatedWorld

WrongFeedback = Literal["any", "another"] | Vector
"""Values of wrong feedback: any in the ranges, those for another agent, or one vector."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RandomStreams:
    """Randomness of R runs of T rounds, with up to A attempts per round.

    Attributes:
        seeds: One seed per run, R.
        scene: Index of the scene, [R, T].
        error_draw: Uniform from 0 to 1; feedback is wrong where it is below the share of wrong
            feedback, [R, T, A].
        wrong: Values of wrong feedback, [R, T, n].
        wrong_fit: Apparent fit of an agent if feedback is wrong, from −1 to 1, [R, T, A].
        mood_noise: Noise of the mood in each second, standard normal, [R, T, A, seconds].
        ties: Order of equal bids if chance decides it, [R, T, A, N].
    """

    seeds: Sequence[int]
    scene: Integers
    error_draw: Floats
    wrong: Floats
    wrong_fit: Floats
    mood_noise: npt.NDArray[np.float32]
    ties: npt.NDArray[np.float32]

    def rounds(self, row: int) -> list[RoundDraws]:
        """Return the randomness of one run, round by round."""
        columns = (
            self.scene[row].tolist(),
            self.error_draw[row].tolist(),
            map(tuple, self.wrong[row].tolist()),
            self.wrong_fit[row].tolist(),
            self.mood_noise[row].tolist(),
            self.ties[row].tolist(),
        )
        return [RoundDraws(*of_round) for of_round in zip(*columns, strict=True)]


class RoundDraws(NamedTuple):
    """Randomness of one round of one run; attributes as in :class:`RandomStreams`."""

    scene: int
    error_draw: list[float]
    wrong: Vector
    wrong_fit: list[float]
    mood_noise: list[list[float]]
    ties: list[list[float]]


def round_seed(seed: int, round_index: int, attempt: int) -> str:
    """Return the seed of a strategy in an attempt of a round."""
    return f"run {seed}/{round_index + 1}.{attempt}"


def draw(
    world: SimulatedWorld, seeds: Sequence[int], rounds: int, wrong: WrongFeedback = "any"
) -> RandomStreams:
    """Draw the randomness of some runs, each from its own seed alone.

    A shorter run is the beginning of a longer one.
    """
    runs, agents, attempts = len(seeds), len(world.agents), world.attempts
    seconds = world.person.seconds if world.person else 0
    drawn = RandomStreams(
        seeds=seeds,
        scene=np.empty((runs, rounds), dtype=np.int64),
        error_draw=np.empty((runs, rounds, attempts)),
        wrong=np.empty((runs, rounds, len(world.space))),
        wrong_fit=np.empty((runs, rounds, attempts)),
        mood_noise=np.empty((runs, rounds, attempts, seconds), dtype=np.float32),
        ties=np.empty((runs, rounds, attempts, agents), dtype=np.float32),
    )
    for row, seed in enumerate(seeds):
        # Each kind has its own stream, so that a shorter run is the beginning of a longer one.
        scenes, errors, anything, another, fits, orders, moods = map(
            np.random.default_rng, np.random.SeedSequence(seed).spawn(7)
        )
        drawn.scene[row] = scenes.integers(len(world.scenes), size=rounds)
        drawn.error_draw[row] = errors.random((rounds, attempts))
        if wrong == "any":
            drawn.wrong[row] = anything.uniform(world.low, world.high, drawn.wrong.shape[1:])
        elif wrong == "another":
            drawn.wrong[row] = world.best[another.integers(agents, size=rounds)]
        else:
            drawn.wrong[row] = wrong
        drawn.wrong_fit[row] = fits.uniform(-1.0, 1.0, (rounds, attempts))
        drawn.ties[row] = orders.random((rounds, attempts, agents), dtype=np.float32)
        drawn.mood_noise[row] = moods.standard_normal((rounds, attempts, seconds), np.float32)
    return drawn
