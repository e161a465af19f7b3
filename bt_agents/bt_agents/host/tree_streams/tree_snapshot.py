# SPDX-License-Identifier: Apache-2.0
"""Tree snapshots: all nodes of a running agent, in the terms of py_trees_ros."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from uuid import NAMESPACE_URL, UUID, uuid5

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.run import Run, TreeOutcome
from bt_agents_language.model.specs import Literal, NodeSpec, iter_nodes
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.node_type import MEMORY
from bt_agents_language.tree.names_read import names_read

READ = "r"
WRITE = "w"


class ShownType(IntEnum):
    """Type of a node for the tools of py_trees_ros."""

    BEHAVIOUR = 1
    SEQUENCE = 2
    SELECTOR = 3
    PARALLEL = 4
    DECORATOR = 6


_TYPES = {
    "sequence": ShownType.SEQUENCE,
    "selector": ShownType.SELECTOR,
    "choose": ShownType.SELECTOR,
    "random": ShownType.SELECTOR,
    "on_failure": ShownType.SELECTOR,
    "parallel": ShownType.PARALLEL,
}


@dataclass(frozen=True, kw_only=True)
class ShownNode:
    """Properties of a node that do not change during a run.

    Attributes:
        parent_id: Id of the parent; None for the root.
        accesses: Keys of the blackboard, each with ``r`` or ``w``.
    """

    path: str
    name: str
    class_name: str
    own_id: UUID
    parent_id: UUID | None
    child_ids: tuple[UUID, ...]
    type: ShownType
    detail: str
    accesses: tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True)
class NodeState:
    """Properties of a node that change during a run.

    Attributes:
        active: Whether it answered in the last tick.
        tip_id: The deepest node below it that decides its status; None if it decides itself.
    """

    status: Status
    message: str
    active: bool
    current_child_id: UUID | None = None
    tip_id: UUID | None = None


def key_of(name: str) -> str:
    """Return the key of a name: ``/scene/mood`` for ``scene.mood``."""
    return "/" + name.replace(".", "/", 1)


def node_id(agent: str, path: str) -> UUID:
    """Return the identifier of a node, the same in each run and each start of a host.

    It has the form of a random UUID, because every reader turns it into one.
    """
    return UUID(bytes=uuid5(NAMESPACE_URL, f"{agent}\n{path}").bytes, version=4)


class TreeSnapshot:
    """The nodes of one run: its tree and ``on_cancel``, below a selector with the agent's name.

    Attributes:
        nodes: The nodes, parents before children.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        spec = run.spec
        self._roots = tuple(root for root in (spec.tree, spec.on_cancel) if root is not None)
        self._ids = {
            node.path: node_id(spec.name, node.path)
            for root in self._roots
            for node in iter_nodes(root)
        }
        self._top_id = node_id(spec.name, "")
        self.nodes = tuple(self._shown())

    def states(self, visited: frozenset[str]) -> list[NodeState]:
        """Return the states of all nodes in order; ``visited`` are the paths that answered."""
        run = self.run
        behaviours: dict[str, Behaviour] = {
            node.spec.path: node
            for root in (run.root, run.clean_up)
            if root is not None
            for node in root.iterate()
        }
        top = self._top()
        return [
            top if not node.path else self._state(behaviours.get(node.path), node.path in visited)
            for node in self.nodes
        ]

    def _shown(self) -> Iterator[ShownNode]:
        spec = self.run.spec
        yield ShownNode(
            path="",
            name=spec.name,
            class_name="bt_agents.agent",
            own_id=self._top_id,
            parent_id=None,
            child_ids=tuple(self._ids[root.path] for root in self._roots),
            type=ShownType.SELECTOR,
            detail="",
            accesses=(),
        )
        parents = {
            child.path: self._ids[node.path]
            for root in self._roots
            for node in iter_nodes(root)
            for child in node.children
        }
        for root in self._roots:
            for node in iter_nodes(root):
                yield ShownNode(
                    path=node.path,
                    name=node.name,
                    class_name=f"bt_agents.{node.kind}",
                    own_id=self._ids[node.path],
                    parent_id=parents.get(node.path, self._top_id),
                    child_ids=tuple(self._ids[child.path] for child in node.children),
                    type=_type(node),
                    detail=_detail(node),
                    accesses=_accesses(node),
                )

    def _top(self) -> NodeState:
        run = self.run
        if run.result is not None:
            succeeded = run.result.outcome is TreeOutcome.SUCCEEDED
            status = Status.SUCCESS if succeeded else Status.FAILURE
        else:
            status = Status.RUNNING if run.ticks else Status.INVALID
        current = run.clean_up or run.root
        tip = current.tip()
        return NodeState(
            status=status,
            message="" if run.result is None else run.result.message,
            active=run.ticks > 0,
            current_child_id=self._id_of(current) if run.ticks else None,
            tip_id=self._id_of(tip) if tip is not None else None,
        )

    def _state(self, node: Behaviour | None, active: bool) -> NodeState:
        if node is None:
            return NodeState(status=Status.INVALID, message="", active=False)
        child = getattr(node, "current_child", None)
        tip = node.tip()
        return NodeState(
            status=node.status,
            message=node.feedback_message,
            active=active,
            current_child_id=self._id_of(child) if child is not None else None,
            tip_id=self._id_of(tip) if tip is not None and tip is not node else None,
        )

    def _id_of(self, node: Behaviour) -> UUID:
        return self._ids[node.spec.path]


def _type(spec: NodeSpec) -> ShownType:
    if spec.kind in _TYPES:
        return _TYPES[spec.kind]
    return ShownType.DECORATOR if spec.children else ShownType.BEHAVIOUR


def _detail(spec: NodeSpec) -> str:
    if _type(spec) is ShownType.PARALLEL:
        return _policy(spec.fields.get("succeed_on"))
    if MEMORY in type_of(spec).fields:
        memory = spec.fields.get(MEMORY.name)
        return "WithMemory" if not isinstance(memory, Literal) or memory.value else ""
    return ""


def _policy(succeed_on: object) -> str:
    match succeed_on:
        case Literal(value="one"):
            return "OnOne"
        case Literal(value=int(count)):
            return f"OnCount({count})"
        case Literal(value=tuple(places)):
            return f"OnSelected({', '.join(map(str, places))})"
    return "OnAll"


def _accesses(spec: NodeSpec) -> tuple[tuple[str, str], ...]:
    written = [*spec.outputs, *spec.feedback]
    if type_of(spec).assigns:
        written += spec.fields
    # A condition on a message also names the message.
    messages = {one.message for one in type_of(spec).fields}
    names = [one for one in names_read(spec) if one.partition(".")[0] not in messages]
    reads = [(key_of(name), READ) for name in dict.fromkeys(names)]
    return (*reads, *[(key_of(name), WRITE) for name in dict.fromkeys(written)])
