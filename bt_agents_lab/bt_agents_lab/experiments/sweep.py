# SPDX-License-Identifier: Apache-2.0
"""Sweep: comparison of strategies and learning rules over many runs, in several processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from itertools import product

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import LearningRule, Update
from bt_agents_lab.experiments.measures import PerRun, of_runs, together
from bt_agents_lab.experiments.random_streams import WrongFeedback, draw
from bt_agents_lab.experiments.simulated_world import Arm, SimulatedWorld
from bt_agents_lab.experiments.simulation import simulate_shares

PART = 1000
"""Runs that are played at once, for the same results in any number of processes."""


@dataclass(frozen=True, kw_only=True)
class Selection:
    """A strategy with its options."""

    strategy: str
    options: Mapping[str, float] = field(default_factory=dict)
    tie_break: str = "least_recently_run"

    @property
    def label(self) -> str:
        """For tables and figures: ``ucb c=2``."""
        parts = [self.strategy, *(f"{name}={value:g}" for name, value in self.options.items())]
        if self.tie_break != "least_recently_run":
            parts.append(f"(ties: {self.tie_break})")
        return " ".join(parts)


@dataclass(frozen=True, kw_only=True)
class Learning:
    """A learning rule of all agents."""

    rule: LearningRule

    @property
    def label(self) -> str:
        """For tables and figures: ``huber width=1``."""
        parts = [str(self.rule.update)]
        if self.rule.update is Update.HUBER and self.rule.width:
            parts.append(f"width={next(iter(self.rule.width.values())):g}")
        if self.rule.update is Update.MEDIAN:
            parts.append(f"window={self.rule.window}")
        if self.rule.anneal:
            parts.append(f"anneal={self.rule.anneal:g}")
        return " ".join(parts)


@dataclass(frozen=True, kw_only=True)
class SweepSpec:
    """Specification of a sweep.

    Attributes:
        title: For people.
        world: World of the runs.
        runs: Runs of each cell; run i has the seed ``seed + i``.
        rounds: Length of a run.
        seed: Of the first run.
        shares: Shares of wrong feedback.
        wrong: Values of wrong feedback.
        selections: Strategies.
        learnings: Learning rules.
    """

    title: str
    world: SimulatedWorld
    runs: int
    rounds: int
    seed: int
    shares: tuple[float, ...]
    wrong: WrongFeedback
    selections: tuple[Selection, ...]
    learnings: tuple[Learning, ...]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One strategy and learning rule under one share of wrong feedback."""

    selection: Selection
    learning: Learning
    share: float


Results = dict[tuple[int, int, int], PerRun]
"""Indices of selection, learning and share → measures of the runs."""


def sweep(
    spec: SweepSpec, processes: int = 1, progress: Callable[[int, int], None] = lambda d, t: None
) -> list[tuple[Cell, PerRun]]:
    """Play every cell and return its measures, in the order of the spec.

    Args:
        spec: The sweep.
        processes: Number that work at once; the result does not depend on it.
        progress: Called with the numbers of tasks that are done, and of all.

    Raises:
        BtAgentsError: A process was ended from outside.
    """
    parts = [
        range(first, min(first + PART, spec.seed + spec.runs))
        for first in range(spec.seed, spec.seed + spec.runs, PART)
    ]
    # The draws of a strategy for some seeds serve all learning rules and shares.
    tasks = list(product(range(len(parts)), range(len(spec.selections))))
    done: dict[tuple[int, int], Results] = {}
    for task, results in _worked(spec, parts, tasks, processes):
        done[task] = results
        progress(len(done), len(tasks))
    cells = []
    for (row, selection), (rule, learning), (place, share) in product(
        enumerate(spec.selections), enumerate(spec.learnings), enumerate(spec.shares)
    ):
        cell = Cell(selection=selection, learning=learning, share=share)
        runs = [done[part, row][row, rule, place] for part in range(len(parts))]
        cells.append((cell, together(runs)))
    return cells


def _worked(
    spec: SweepSpec, parts: list[range], tasks: list[tuple[int, int]], processes: int
) -> Iterator[tuple[tuple[int, int], Results]]:
    if processes <= 1:
        for part, selection in tasks:
            yield (part, selection), _play(spec, parts[part], selection)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        waiting: dict[Future[Results], tuple[int, int]] = {
            pool.submit(_play, spec, parts[part], selection): (part, selection)
            for part, selection in tasks
        }
        try:
            while waiting:
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    yield waiting.pop(future), future.result()
        except BrokenProcessPool:
            raise BtAgentsError(
                "a process of the sweep was ended from outside; with little memory, take fewer "
                "with --processes"
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)


def _play(spec: SweepSpec, seeds: range, selection: int) -> Results:
    """Play some runs with one strategy and every learning rule and share."""
    chosen = spec.selections[selection]
    streams = draw(spec.world, seeds, spec.rounds, spec.wrong)
    results = {}
    for rule, learning in enumerate(spec.learnings):
        arm = Arm(
            strategy=chosen.strategy,
            options=chosen.options,
            tie_break=chosen.tie_break,
            rule=learning.rule,
        )
        courses = simulate_shares(spec.world, arm, streams, spec.shares)
        for place, course in enumerate(courses):
            results[selection, rule, place] = of_runs(spec.world, streams, course)
    return results
