# SPDX-License-Identifier: Apache-2.0
"""Measures the cost of collecting the status changes of a tick."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.run import StatusChange
from bt_agents.engine.ticker import Ticker
from engines import light_behaviours
from measuring import Effort, Row, in_turn, timed
from reference_trees import RUNNING, TREES, Shape, balanced

TRACED = 1.15
"""Goal: ratio of a tick with collected changes to a bare one."""

LARGE = 3.0
"""Goal: ratio between a tick of a large tree and a tick of a small one."""

EACH_S = 0.005
"""Approximate time of each measurement [s]."""

FINE = 10
"""Factor of repetitions: goals close to 1 need many short measurements in quick turn."""

SMALL_NODES, LARGE_NODES = 10, 5000


def measure(effort: Effort) -> Iterator[Row]:
    """Compare ticks with and without collecting."""
    for case, shape in TREES.items():
        _check_reported(case, shape)
        bare, traced = Ticker(light_behaviours(shape)[0]).tick, _tracing(shape)
        yield _compared(case, ("traced", traced), ("bare tick", bare), effort, TRACED)
    small, large = (_tracing(balanced(nodes, 10, RUNNING)) for nodes in (SMALL_NODES, LARGE_NODES))
    case = "one running path, traced"
    yield _compared(case, ("5,000 nodes", large), ("10 nodes", small), effort, LARGE)


def _check_reported(case: str, shape: Shape) -> None:
    """Check that all changes are reported, and only changes.

    Raises:
        RuntimeError: The reports are wrong.
    """
    root, _ = light_behaviours(shape)
    reported: list[Behaviour] = []
    ticker = Ticker(root, on_change=reported.append)
    ticker.tick()
    changed = {node for node in root.iterate() if node.status is not Status.INVALID}
    first = set(reported)
    reported.clear()
    ticker.tick()
    if first != changed or reported:
        raise RuntimeError(f"not every change of '{case}' is reported, or one that is none")


def _tracing(shape: Shape) -> Callable[[], object]:
    """Return a tick of a tree that collects the changes."""
    changes: deque[StatusChange] = deque(maxlen=LARGE_NODES)

    def collect(node: Behaviour) -> None:
        changes.append(
            StatusChange(
                path=node.name, name=node.name, status=node.status, message=node.feedback_message
            )
        )

    return Ticker(light_behaviours(shape)[0], on_change=collect).tick


def _compared(
    case: str,
    side: tuple[str, Callable[[], object]],
    floor: tuple[str, Callable[[], object]],
    effort: Effort,
    goal: float,
) -> Row:
    """Compare two named ticks, measured in turn after a warm-up."""
    ways = {}
    for name, tick in (side, floor):
        once = timed(tick, effort.times(100), time.thread_time)
        once()
        number = max(1, round(effort.scale * EACH_S / once()))
        ways[name] = timed(tick, number, time.thread_time)
    found = in_turn(ways, replace(effort, repetitions=FINE * effort.repetitions))
    return Row.beside(found, side[0], floor[0], case=case, goal=goal)
