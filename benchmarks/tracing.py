# SPDX-License-Identifier: Apache-2.0
"""What it costs to collect the status changes of a tick."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.trees import BehaviourTree
from py_trees.visitors import SnapshotVisitor

from bt_agents.engine.light_behaviour import LightBehaviour
from bt_agents.engine.run import StatusChange
from bt_agents.engine.ticker import Ticker
from engines import behaviours, light_behaviours
from measuring import Effort, Row, in_turn, timed
from reference_trees import RUNNING, SUCCESS, TREES, Shape, balanced, sequence

TRACED = 1.15
"""Goal: of a tick whose changes are collected to a bare one."""

LARGE = 3.0
"""Goal: of a tick of a large tree to that of a small one."""

EACH_S = 0.005
"""About how long each measurement takes [s]."""

FINE = 10
"""Times as many measurements as elsewhere: goals near to 1 need short ones in quick turn."""

SMALL_NODES, LARGE_NODES = 10, 5000

BARE, TRACE, STOCK, VISITOR = "bare tick", "traced", "py_trees", "py_trees, SnapshotVisitor"
SMALL, BIG, STOCK_SMALL, STOCK_BIG = "10 nodes", "5,000 nodes", "py_trees 10", "py_trees 5,000"

BUILDERS = (light_behaviours, behaviours)
"""Ours and that of py_trees."""


def measure(effort: Effort) -> Iterator[Row]:
    """Compare ticks with and without."""
    for case, shape in TREES.items():
        _check_reported(case, shape)
        ours, stock = (lambda of=shape, make=make: make(of)[0] for make in BUILDERS)
        yield from _traced(case, ours, stock, effort, TRACED)
    case = "a, with a new message in each tick"
    yield from _traced(case, _talkative_light, _talkative, effort, None)
    yield from _large(effort)


def _check_reported(case: str, shape: Shape) -> None:
    """See that what changes is reported, and nothing else.

    Raises:
        RuntimeError: It is not so.
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


class _Talkative(Behaviour):
    """A leaf with another message each time."""

    def update(self) -> Status:
        self.feedback_message = "b" if self.feedback_message == "a" else "a"
        return Status.SUCCESS


class _TalkativeLight(LightBehaviour):
    """The same leaf on the base class of our nodes."""

    update = _Talkative.update


def _talkative() -> Behaviour:
    root, leaves = behaviours(sequence(*[SUCCESS] * 10))
    root.replace_child(leaves[-1], _Talkative("talkative"))
    return root


def _talkative_light() -> Behaviour:
    root, leaves = light_behaviours(sequence(*[SUCCESS] * 10))
    root.replace_child(leaves[-1], _TalkativeLight("talkative"))
    return root


def _traced(
    case: str,
    ours: Callable[[], Behaviour],
    stock: Callable[[], Behaviour],
    effort: Effort,
    goal: float | None,
) -> Iterator[Row]:
    ticks = {
        BARE: Ticker(ours()).tick,
        TRACE: _tracing(ours()),
        STOCK: stock().tick_once,
        VISITOR: _visited(stock()),
    }
    found = _in_turn(ticks, effort)
    yield _row(case, TRACE, BARE, found, goal)
    yield _row(case, VISITOR, STOCK, found)


def _large(effort: Effort) -> Iterator[Row]:
    small, large = (balanced(nodes, 10, RUNNING) for nodes in (SMALL_NODES, LARGE_NODES))
    ticks = {
        SMALL: _tracing(light_behaviours(small)[0]),
        BIG: _tracing(light_behaviours(large)[0]),
        STOCK_SMALL: _visited(behaviours(small)[0]),
        STOCK_BIG: _visited(behaviours(large)[0]),
    }
    found = _in_turn(ticks, effort)
    case = "one running path, traced"
    yield _row(case, BIG, SMALL, found, LARGE)
    yield _row(case, STOCK_BIG, STOCK_SMALL, found)


def _row(
    case: str, side: str, floor: str, found: Mapping[str, list[float]], goal: float | None = None
) -> Row:
    return Row(
        case=case, side=side, values=found[side], floor=floor, floor_values=found[floor], goal=goal
    )


def _tracing(root: Behaviour) -> Callable[[], object]:
    """Return a tick that collects what has changed."""
    changes: deque[StatusChange] = deque(maxlen=LARGE_NODES)

    def collect(node: Behaviour) -> None:
        changes.append(
            StatusChange(
                path=node.name, name=node.name, status=node.status, message=node.feedback_message
            )
        )

    return Ticker(root, on_change=collect).tick


def _visited(root: Behaviour) -> Callable[[], object]:
    """Return a tick of a py_trees tree with its visitor for snapshots."""
    tree = BehaviourTree(root)
    tree.visitors.append(SnapshotVisitor())
    return tree.tick


def _in_turn(ticks: Mapping[str, Callable[[], object]], effort: Effort) -> dict[str, list[float]]:
    """Measure ticks in turn, after some that are not measured."""
    ways = {}
    for name, tick in ticks.items():
        once = timed(tick, effort.times(100), time.thread_time)
        once()
        number = max(1, round(effort.scale * EACH_S / once()))
        ways[name] = timed(tick, number, time.thread_time)
    return in_turn(ways, replace(effort, repetitions=FINE * effort.repetitions))
