# SPDX-License-Identifier: Apache-2.0
"""All chance of many runs, drawn from one seed a run: the same whatever is compared with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from bt_agents_core.scene import Vector
from bt_agents_lab.experiments.seeding import sources
from bt_agents_lab.experiments.simulated_world import SimulatedWorld
from marketplace_node.strategies.arrays import Floats, Integers

Bools = npt.NDArray[np.bool_]
Drawn = dict[tuple[object, ...], tuple[Floats, Bools]]
Said = Literal["any", "another"] | Vector
"""What wrong feedback says: anything in the ranges, what suits another agent, or one vector."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RandomStreams:
    """Chance of R runs of T rounds, with up to A attempts a round.

    Attributes:
        seeds: One a run, R.
        scene: Index of the scene, [R, T].
        doubt: Drawn evenly from 0 to 1; feedback is wrong where it is below the share of wrong
            feedback, [R, T, A].
        said: What wrong feedback says, [R, T, n].
        whim: How well an agent seems to fit where feedback is wrong, from −1 to 1, [R, T, A].
        mood: What else changes the mood each second, standard normal, [R, T, A, seconds].
        ties: Order of equal bids where chance decides it, [R, T, A, N].
    """

    seeds: Sequence[int]
    scene: Integers
    doubt: Floats
    said: Floats
    whim: Floats
    mood: npt.NDArray[np.float32]
    ties: npt.NDArray[np.float32]
    _drawn: Drawn = field(default_factory=dict)

    def fill(self, runs: Integers, round_index: int, attempt: int, calls: Calls) -> Floats:
        """Return the last of a list of draws for some runs, [runs, ...]; each run's is kept."""
        key = (round_index, attempt, calls)
        if key not in self._drawn:
            shape = (len(self.seeds), *calls[-1][1])
            self._drawn[key] = (np.empty(shape), np.zeros(len(self.seeds), dtype=bool))
        values, known = self._drawn[key]
        fresh = np.flatnonzero(np.bincount(runs[~known[runs]], minlength=len(known))).tolist()
        if fresh:
            seeds = [seed_of(self.seeds[run], round_index, attempt) for run in fresh]
            for run, source in zip(fresh, sources(seeds), strict=True):
                for kind, shape in calls:
                    values[run] = getattr(source, kind)(shape)
            known[runs] = True
        return values[runs]


class StreamMoment:
    """The chance of some runs in one attempt of one round.

    Args:
        luck: Of all runs.
        runs: Which of them, by index; one may be there more than once.
        round_index: From 0.
        attempt: From 0.
    """

    def __init__(
        self, luck: RandomStreams, runs: Integers, round_index: int, attempt: int
    ) -> None:
        self.attempt = attempt
        self._luck = luck
        self._runs = runs
        self._round = round_index

    def chance(self) -> ReplicaRandomSource:
        """Return what a strategy draws from."""
        return ReplicaRandomSource(self._luck, self._runs, self._round, self.attempt)

    @property
    def scene(self) -> Integers:
        """As in :class:`RandomStreams`, [runs]."""
        return np.asarray(self._luck.scene[self._runs, self._round])

    @property
    def doubt(self) -> Floats:
        """As in :class:`RandomStreams`, [runs]."""
        return np.asarray(self._luck.doubt[self._runs, self._round, self.attempt])

    @property
    def said(self) -> Floats:
        """As in :class:`RandomStreams`, [runs, n]."""
        return np.asarray(self._luck.said[self._runs, self._round])

    @property
    def whim(self) -> Floats:
        """As in :class:`RandomStreams`, [runs]."""
        return np.asarray(self._luck.whim[self._runs, self._round, self.attempt])

    @property
    def mood(self) -> npt.NDArray[np.float32]:
        """As in :class:`RandomStreams`, [runs, seconds]."""
        return np.asarray(self._luck.mood[self._runs, self._round, self.attempt])

    @property
    def ties(self) -> npt.NDArray[np.float32]:
        """As in :class:`RandomStreams`, [runs, N]."""
        return np.asarray(self._luck.ties[self._runs, self._round, self.attempt])


Calls = tuple[tuple[str, tuple[int, ...]], ...]
"""Draws one after the other: kind, and shape for one run."""


class ReplicaRandomSource:
    """Draws for many runs at once what each would draw alone: a ``strategies.Chance``."""

    def __init__(
        self, luck: RandomStreams, rows: Integers, round_index: int, attempt: int
    ) -> None:
        self._luck = luck
        self._where = (rows, round_index, attempt)
        self._calls: Calls = ()

    def random(self, size: tuple[int, ...], /) -> Floats:
        """Return numbers drawn evenly from 0 to 1, the first axis being the runs."""
        return self._next("random", size)

    def standard_normal(self, size: tuple[int, ...], /) -> Floats:
        """Return numbers from the standard normal distribution, the first axis being the runs."""
        return self._next("standard_normal", size)

    def _next(self, kind: str, size: tuple[int, ...]) -> Floats:
        self._calls = (*self._calls, (kind, size[1:]))
        return self._luck.fill(*self._where, self._calls)


def seed_of(seed: int, round_index: int, attempt: int) -> str:
    """Return what the strategy's chance of a round is seeded with."""
    return f"run {seed}/{round_index + 1}.{attempt}"


def draw(
    world: SimulatedWorld, seeds: Sequence[int], rounds: int, said: Said = "any"
) -> RandomStreams:
    """Draw the chance of some runs.

    Args:
        world: What the runs are about.
        seeds: One a run; what a run draws depends on its own alone.
        rounds: Length of each run; a shorter run is the beginning of a longer one.
        said: What wrong feedback says.
    """
    runs, agents, attempts = len(seeds), len(world.agents), world.attempts
    width = len(world.space)
    seconds = world.person.seconds if world.person else 0
    scene = np.empty((runs, rounds), dtype=np.int64)
    doubt = np.empty((runs, rounds, attempts))
    wrong = np.empty((runs, rounds, width))
    whim = np.empty((runs, rounds, attempts))
    mood = np.empty((runs, rounds, attempts, seconds), dtype=np.float32)
    ties = np.empty((runs, rounds, attempts, agents), dtype=np.float32)
    for row, seed in enumerate(seeds):
        # A stream for each kind, so that a shorter run is the beginning of a longer one.
        scenes, doubts, anything, another, whims, chances, moods = map(
            np.random.default_rng, np.random.SeedSequence(seed).spawn(7)
        )
        scene[row] = scenes.integers(len(world.scenes), size=rounds)
        doubt[row] = doubts.random((rounds, attempts))
        if said == "any":
            wrong[row] = anything.uniform(world.low, world.high, (rounds, width))
        elif said == "another":
            wrong[row] = world.best[another.integers(agents, size=rounds)]
        else:
            wrong[row] = said
        whim[row] = whims.uniform(-1.0, 1.0, (rounds, attempts))
        ties[row] = chances.random((rounds, attempts, agents), dtype=np.float32)
        mood[row] = moods.standard_normal((rounds, attempts, seconds), dtype=np.float32)
    return RandomStreams(
        seeds=seeds, scene=scene, doubt=doubt, said=wrong, whim=whim, mood=mood, ties=ties
    )
