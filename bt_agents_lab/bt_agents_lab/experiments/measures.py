# SPDX-License-Identifier: Apache-2.0
"""Measures of simulated runs: right selections, regret, starvation, convergence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bt_agents_lab.experiments.random_streams import RandomStreams
from bt_agents_lab.experiments.simulated_world import Bools, Floats, Integers, SimulatedWorld
from bt_agents_lab.experiments.simulation import Course

LAST = 100
"""Number of rounds at the end of a run that count as learned."""

SETTLED = 0.95
WINDOW = 20
"""Window length: a run has converged when all later windows of this length are right enough."""

Z95 = 1.959963984540054


@dataclass(frozen=True, kw_only=True)
class Interval:
    """Share with its 95 % interval; all 0..1."""

    share: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False)
class PerRun:
    """Measures of each of R runs.

    Attributes:
        late: Share of the last scenes that a best suited agent got, [R].
        served: Whether every agent that suits a scene best ran for one in the last rounds, if
            one occurred, [R].
        ran: Whether every agent ran at all, [R].
        regret: Sum over the misfit of the selected agent minus the misfit of the best one, [R].
        cycles: Rounds until a run stays right, [R]; infinite if it never does.
        cancelled: Share of scenes with a cancelled run, [R].
        error: Mean Manhattan distance at the end of a profile to the scene of its agent, [R].
        right: Number of runs that were right in each round, [T].
    """

    late: Floats
    served: Bools
    ran: Bools
    regret: Floats
    cycles: Floats
    cancelled: Floats
    error: Floats
    right: Integers


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of many runs together, mostly means of those in :class:`PerRun`.

    Attributes:
        accuracy: Mean of ``late``.
        worst: The ``late`` of the worst run.
        starved: Share of runs that are not ``served``.
        never: Share of runs where an agent never ran.
        cycles: Median number of rounds until convergence; infinite if less than half converged.
    """

    runs: int
    accuracy: float
    worst: float
    starved: Interval
    never: Interval
    regret: float
    cycles: float
    cancelled: float
    error: float


def right(world: SimulatedWorld, streams: RandomStreams, course: Course) -> Bools:
    """Return whether each scene went to an agent that none suits better, [R, T]."""
    chosen, least = _misfits(world, streams, course)
    return np.asarray(chosen == least)


def of_runs(world: SimulatedWorld, streams: RandomStreams, course: Course) -> PerRun:
    """Return the measures of each run."""
    chosen, least = _misfits(world, streams, course)
    correct = chosen == least
    late = correct[:, -LAST:]
    rounds = correct.shape[1]
    return PerRun(
        late=late.mean(axis=1),
        served=_served(world, streams, course, late),
        ran=course.all_ran,
        regret=np.asarray((chosen - least).sum(axis=1)),
        cycles=converged(correct),
        cancelled=(course.cancelled > 0).mean(axis=1),
        error=np.abs(course.profiles[:, -1] - world.best_in(rounds - 1))
        .sum(axis=-1)
        .mean(axis=-1),
        right=correct.sum(axis=0),
    )


def _misfits(
    world: SimulatedWorld, streams: RandomStreams, course: Course
) -> tuple[Floats, Floats]:
    """Return the misfits of the selected agents, and the smallest misfits, both [R, T]."""
    rounds = np.arange(streams.scene.shape[1])
    misfit = np.stack([world.misfit_in(index) for index in rounds.tolist()])
    least = misfit.min(axis=-1)[rounds, streams.scene]
    return misfit[rounds, streams.scene, course.awarded], least


def _served(world: SimulatedWorld, streams: RandomStreams, course: Course, late: Bools) -> Bools:
    """Return whether every agent got one of the last scenes that none suits better, [R].

    Agents without such a scene are not counted.
    """
    misfit = world.misfit_in(streams.scene.shape[1] - 1)
    scenes, awarded = streams.scene[:, -LAST:], course.awarded[:, -LAST:]
    served = np.ones(len(late), dtype=bool)
    for agent, suits in enumerate((misfit == misfit.min(axis=-1, keepdims=True)).T):
        came = suits[scenes].any(axis=1)
        served &= ~came | ((awarded == agent) & late).any(axis=1)
    return served


def together(parts: Sequence[PerRun]) -> PerRun:
    """Return the runs of several parts, in order."""
    names = ("late", "served", "ran", "regret", "cycles", "cancelled", "error")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return PerRun(**joined, right=np.sum([part.right for part in parts], axis=0))


def summary(runs: PerRun) -> Measures:
    """Return the measures of all runs together."""
    count = len(runs.late)
    return Measures(
        runs=count,
        accuracy=float(runs.late.mean()),
        worst=float(runs.late.min()),
        starved=wilson(int((~runs.served).sum()), count),
        never=wilson(int((~runs.ran).sum()), count),
        regret=float(runs.regret.mean()),
        cycles=float(np.median(runs.cycles)),
        cancelled=float(runs.cancelled.mean()),
        error=float(runs.error.mean()),
    )


def converged(correct: Bools) -> Floats:
    """Return the round from which each run stays right, [R]; infinite if it never does."""
    width = min(WINDOW, correct.shape[1])
    sums = np.cumsum(np.pad(correct, ((0, 0), (1, 0))), axis=1)
    good = (sums[:, width:] - sums[:, :-width]) >= SETTLED * width
    stays = np.logical_and.accumulate(good[:, ::-1], axis=1)[:, ::-1]
    first = np.where(stays.any(axis=1), np.argmax(stays, axis=1) + 1.0, math.inf)
    return np.asarray(first)


def wilson(hits: int, runs: int) -> Interval:
    """Return a share with its 95 % interval by Wilson's score (1927), also right near 0 and 1."""
    if runs == 0:
        return Interval(share=math.nan, low=0.0, high=1.0)
    share = hits / runs
    spread = Z95**2 / runs
    centre = (share + spread / 2.0) / (1.0 + spread)
    half = Z95 / (1.0 + spread) * math.sqrt(share * (1.0 - share) / runs + spread / (4.0 * runs))
    return Interval(
        share=share,
        low=0.0 if hits == 0 else centre - half,
        high=1.0 if hits == runs else centre + half,
    )
