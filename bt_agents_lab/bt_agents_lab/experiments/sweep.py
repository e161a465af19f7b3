# SPDX-License-Identifier: Apache-2.0
"""Sweeps: comparison of strategies and learning rules over many runs, in several processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Generator
from contextlib import closing, suppress
from dataclasses import dataclass
from itertools import product
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import LearningRule, Update
from bt_agents_lab.experiments.measures import PerRun, of_runs, together
from bt_agents_lab.experiments.random_streams import WrongFeedback, draw
from bt_agents_lab.experiments.simulated_world import Arm, Selection, SimulatedWorld
from bt_agents_lab.experiments.simulation import simulate
from bt_agents_ros.signals import Interrupt, sigint_blocked

_POLL_S = 0.1

PART = 20
"""Number of runs per task; it is fixed, so that results do not depend on the processes."""


def rule_label(rule: LearningRule) -> str:
    """Return the label of a learning rule for tables and figures: ``huber width=1``."""
    parts = [str(rule.update)]
    if rule.update is Update.HUBER and rule.width:
        parts.append(f"width={next(iter(rule.width.values())):g}")
    if rule.update is Update.MEDIAN:
        parts.append(f"window={rule.window}")
    if rule.anneal:
        parts.append(f"anneal={rule.anneal:g}")
    return " ".join(parts)


@dataclass(frozen=True, kw_only=True)
class SweepSpec:
    """Specification of a sweep.

    Attributes:
        runs: Number of runs per cell; run i has the seed ``seed + i``.
        rounds: Length of a run.
        shares: Shares of wrong feedback.
        wrong: Values of wrong feedback.
    """

    title: str
    world: SimulatedWorld
    runs: int
    rounds: int
    seed: int
    shares: tuple[float, ...]
    wrong: WrongFeedback
    selections: tuple[Selection, ...]
    learnings: tuple[LearningRule, ...]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One strategy and learning rule with one share of wrong feedback."""

    selection: Selection
    learning: LearningRule
    share: float


Results = dict[tuple[int, int], PerRun]
"""Indices of learning and share → measures of the runs."""


def sweep(
    spec: SweepSpec, processes: int = 1, progress: Callable[[int, int], None] = lambda d, t: None
) -> list[tuple[Cell, PerRun]]:
    """Play every cell and return their measures, in the order of the spec.

    The result does not depend on the number of processes. ``progress`` takes the numbers of
    finished tasks and of all tasks.

    Raises:
        BtAgentsError: A process of the sweep ended early, perhaps killed for its memory.
    """
    parts = [
        range(first, min(first + PART, spec.seed + spec.runs))
        for first in range(spec.seed, spec.seed + spec.runs, PART)
    ]
    # All learning rules and shares use the same draws of a strategy for some seeds.
    tasks = list(product(range(len(parts)), range(len(spec.selections))))
    done: dict[tuple[int, int], Results] = {}
    with closing(_worked(spec, parts, tasks, processes)) as worked:
        for task, results in worked:
            done[task] = results
            progress(len(done), len(tasks))
    return [
        (
            Cell(selection=selection, learning=learning, share=share),
            together([done[part, row][rule, place] for part in range(len(parts))]),
        )
        for (row, selection), (rule, learning), (place, share) in product(
            enumerate(spec.selections), enumerate(spec.learnings), enumerate(spec.shares)
        )
    ]


def _worked(
    spec: SweepSpec, parts: list[range], tasks: list[tuple[int, int]], processes: int
) -> Generator[tuple[tuple[int, int], Results], None, None]:
    if processes <= 1:
        for part, selection in tasks:
            yield (part, selection), _play(spec, parts[part], selection)
        return
    # An interrupted ProcessPoolExecutor may hang or print a traceback.
    context = multiprocessing.get_context("spawn")
    left = iter(tasks)
    busy: dict[Connection, tuple[int, int]] = {}
    workers: list[SpawnProcess] = []

    def give_next(connection: Connection) -> None:
        if (task := next(left, None)) is not None:
            connection.send(task)
            busy[connection] = task

    interrupt = Interrupt()
    try:
        # Only this process gets a Ctrl-C; it ends the workers. The resource tracker, which would
        # start with the first worker, unblocks the signal.
        resource_tracker.ensure_running()
        with sigint_blocked():
            for _ in range(min(processes, len(tasks))):
                connection, its = context.Pipe()
                worker = context.Process(target=_work, args=(its, spec, parts))
                worker.start()
                its.close()
                workers.append(worker)
                give_next(connection)
        while busy and not interrupt:
            wait(list(busy), _POLL_S)
            for connection in [one for one in busy if one.poll()]:
                yield busy.pop(connection), connection.recv()
                give_next(connection)
    except (EOFError, ConnectionError):
        raise BtAgentsError(
            "a process of the sweep ended early; with little memory, take fewer with --processes"
        ) from None
    finally:
        interrupt.release()
        for worker in workers:
            worker.kill()
            worker.join()
    if interrupt:
        raise KeyboardInterrupt


def _work(connection: Connection, spec: SweepSpec, parts: list[range]) -> None:
    """Play tasks that arrive on a connection until it ends."""
    with suppress(EOFError, ConnectionError):
        while True:
            part, selection = connection.recv()
            connection.send(_play(spec, parts[part], selection))


def _play(spec: SweepSpec, seeds: range, selection: int) -> Results:
    """Play some runs with one strategy and every learning rule and share."""
    chosen = vars(spec.selections[selection])
    streams = draw(spec.world, seeds, spec.rounds, spec.wrong)
    return {
        (rule, place): of_runs(
            spec.world, streams, simulate(spec.world, Arm(**chosen, rule=learning), streams, share)
        )
        for rule, learning in enumerate(spec.learnings)
        for place, share in enumerate(spec.shares)
    }
