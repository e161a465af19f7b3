# SPDX-License-Identifier: Apache-2.0
"""Analysis of one tick: the marks for coverage, and whether another tick would do nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.catalogue import DECORATORS, type_of
from bt_agents_language.nodes.node_type import Mark

Ticked = Sequence[tuple[Behaviour, Status]]
"""Nodes of one tick in the order in which they answered, and how."""

_LIMITS = tuple(f"@{one.key}" for one in DECORATORS.values() if one.limits)


def spec_of(node: Behaviour) -> NodeSpec | None:
    """Return the spec that a node was built from."""
    spec = getattr(node, "spec", None)
    return spec if isinstance(spec, NodeSpec) else None


def mark(ticked: Ticked, marks: dict[str, set[Mark]]) -> None:
    """Note which ways a tick has gone."""
    answers = {id(node): status for node, status in ticked}
    for node, status in ticked:
        spec = spec_of(node)
        if spec is None:
            continue
        node_type = type_of(spec)
        found = marks.setdefault(spec.path, set())
        found.add(Mark.TICKED)
        child = answers.get(id(node.children[0])) if node.children else None
        if status is Status.SUCCESS:
            found.add(Mark.SUCCEEDED)
        elif status is Status.FAILURE:
            found.add(Mark.FAILED)
            if node_type.limits and child is not Status.FAILURE:
                found.add(Mark.BROKEN_OFF)
        if node_type.skips and child is None:
            found.add(Mark.LEFT_OUT)


def at_rest(ticked: Ticked, wakes: Mapping[str, float]) -> bool:
    """Return whether another tick would do nothing until an event, or a time in ``wakes``, comes.

    It would when every running node waits for a running child, for the world or for a time that
    it has named, and no leaf has done anything that it would do again.
    """
    return all(_rests(node, status, wakes) for node, status in ticked)


def _rests(node: Behaviour, status: Status, wakes: Mapping[str, float]) -> bool:
    spec = spec_of(node)
    if spec is None:
        return False
    running = status is Status.RUNNING
    if node.children:
        below = any(child.status is Status.RUNNING for child in node.children)
        return not running or below or spec.path in wakes
    node_type = type_of(spec)
    return node_type.idle and (running or node_type.read_only)


def running_leaves(ticked: Iterable[tuple[Behaviour, Status]]) -> list[NodeSpec]:
    """Return the leaves that are under way."""
    return [
        spec
        for node, status in ticked
        if status is Status.RUNNING and not node.children and (spec := spec_of(node)) is not None
    ]


def limit_of(node: NodeSpec, wakes: Mapping[str, float]) -> float:
    """Return when a wait is over at the latest, as far as a limit around it says so [s]."""
    around = (
        at
        for path, at in wakes.items()
        if path.endswith(_LIMITS) and _inside(node.path, path.rpartition("@")[0])
    )
    return min(around, default=math.inf)


def _inside(path: str, outer: str) -> bool:
    return path == outer or path.startswith((f"{outer}/", f"{outer}@"))
