# SPDX-License-Identifier: Apache-2.0
"""Analysis of one tick: the marks for coverage, and whether another tick would do nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.node_errors import is_undecided
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.catalogue import DECORATORS, type_of
from bt_agents_language.nodes.node_type import Mark

Ticked = Sequence[tuple[Behaviour, Status]]
"""Nodes of one tick with their statuses, in the order of their answers."""

_LIMITS = tuple(f"@{one.key}" for one in DECORATORS.values() if one.limits)


def spec_of(node: Behaviour) -> NodeSpec | None:
    """Return the spec of a node."""
    spec = getattr(node, "spec", None)
    return spec if isinstance(spec, NodeSpec) else None


def add_marks(ticked: Ticked, marks: dict[str, set[Mark]]) -> None:
    """Add the marks of a tick to the marks of earlier ones."""
    answers = {id(node): status for node, status in ticked}
    for node, status in ticked:
        spec = spec_of(node)
        if spec is None:
            continue
        node_type = type_of(spec)
        found = marks.setdefault(spec.path, set())
        found.add(Mark.TICKED)
        if status is Status.FAILURE and is_undecided(node.feedback_message):
            continue
        child = answers.get(id(node.children[0])) if node.children else None
        if status is Status.SUCCESS:
            found.add(Mark.SUCCEEDED)
        elif status is Status.FAILURE:
            found.add(Mark.FAILED)
            if node_type.limits and child is not Status.FAILURE:
                found.add(Mark.BROKEN_OFF)
        if node_type.skips and child is None:
            found.add(Mark.LEFT_OUT)


def at_rest(ticked: Ticked, deadlines: Mapping[str, float]) -> bool:
    """Return whether another tick would do nothing before the next event or deadline.

    This is true if every running node waits for a running child, for its environment or for its
    own deadline, and no leaf has done anything that it would do again.
    """
    return all(_rests(node, status, deadlines) for node, status in ticked)


def _rests(node: Behaviour, status: Status, deadlines: Mapping[str, float]) -> bool:
    spec = spec_of(node)
    if spec is None:
        return False
    running = status is Status.RUNNING
    if node.children:
        below = any(child.status is Status.RUNNING for child in node.children)
        return not running or below or spec.path in deadlines
    node_type = type_of(spec)
    return node_type.idle and (running or node_type.read_only)


def running_leaves(ticked: Iterable[tuple[Behaviour, Status]]) -> list[NodeSpec]:
    """Return the running leaves."""
    return [
        spec
        for node, status in ticked
        if status is Status.RUNNING and not node.children and (spec := spec_of(node)) is not None
    ]


def limit_of(node: NodeSpec, deadlines: Mapping[str, float]) -> float:
    """Return the earliest deadline of the limits around a waiting node [s]; infinite for none."""
    around = []
    for path, at in deadlines.items():
        outer = path.rpartition("@")[0]
        if path.endswith(_LIMITS) and f"{node.path}/".startswith((f"{outer}/", f"{outer}@")):
            around.append(at)
    return min(around, default=math.inf)
