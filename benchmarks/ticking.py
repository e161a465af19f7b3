# SPDX-License-Identifier: Apache-2.0
"""Measures a tick of reference trees, against py_trees, BehaviorTree.CPP and bonsai-bt."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from engines import Built, only_leaves, ours, py_trees
from measuring import OURS, Effort, Row, in_turn
from peers import CPP, PEERS
from reference_trees import TREES, Shape

GOALS = {"a": 0.10, "b": 0.10, "c": 0.10, "d": 0.10, "e": 0.17, "f": 0.17}
"""Goals for the ratio of our time to stock py_trees, by the letter of the tree."""

EACH_S = 0.05
"""Approximate time of each measurement [s]."""

STOCK = "py_trees"
LEAVES = "the leaves alone"

BUILDERS: Mapping[str, Callable[[Shape], Built]] = {
    STOCK: py_trees,
    OURS: ours,
    **{name: peer.build for name, peer in PEERS.items() if peer.is_installed},
}


def measure(effort: Effort) -> Iterator[Row]:
    """Compare all engines on each tree."""
    for case, shape in TREES.items():
        yield from _compared(case, shape, effort)


def _compared(case: str, shape: Shape, effort: Effort) -> Iterator[Row]:
    remarks = [f"{name} is not installed" for name, peer in PEERS.items() if not peer.is_installed]
    built = {name: build(shape) for name, build in BUILDERS.items()}
    built[LEAVES] = only_leaves(shape)
    steps = _check_alike(case, built)
    ways = {name: one.way(_number(one, effort)) for name, one in built.items()}
    found = in_turn(ways, effort)
    for name, one in built.items():
        _check_counts(case, name, one, steps)
    note = "; ".join(remarks)
    yield Row.beside(found, OURS, STOCK, case=case, goal=GOALS[case[0]], note=note)
    if CPP in found:
        yield Row.beside(found, OURS, CPP, case=case, goal=1.0)
    for name in found:
        if name not in (OURS, STOCK):
            yield Row.beside(found, name, STOCK, case=case)


def _check_alike(case: str, built: Mapping[str, Built]) -> list[tuple[int, int]]:
    """Check that all engines give the same answers and tick the same leaves.

    Returns:
        Ticks of each leaf in the first tick, and in each further one.

    Raises:
        RuntimeError: The engines differ.
    """
    steps: list[tuple[int, int]] = []
    for name, one in built.items():
        if name == LEAVES:
            continue
        answers, counts = [], [one.counts()]
        for _ in range(3):
            answers.append(one.tick_once())
            counts.append(one.counts())
        if not steps:
            expected = answers, counts
            steps = [(b - a, c - b) for a, b, c, _ in zip(*counts, strict=True)]
        elif (answers, counts) != expected:
            raise RuntimeError(f"{name} ticks '{case}' otherwise than {STOCK}")
    return steps


def _check_counts(case: str, name: str, one: Built, steps: list[tuple[int, int]]) -> None:
    """Check that the measured ticks have also ticked each leaf."""
    expected = [first + (one.ticked - 1) * further for first, further in steps]
    if one.counts() != expected:
        raise RuntimeError(f"{name} has ticked '{case}' {one.ticked} times, but not its leaves")


def _number(one: Built, effort: Effort) -> int:
    """Return the number of ticks that last long enough to measure."""
    return max(1, round(effort.scale * EACH_S / one.way(effort.times(100))()))
