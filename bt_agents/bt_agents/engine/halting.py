# SPDX-License-Identifier: Apache-2.0
"""How nodes of py_trees end and are stopped, by plain calls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Composite, Parallel, Selector, Sequence
from py_trees.decorators import Decorator

# Looking a member of an Enum up by its name takes as long as three calls in Python 3.11.
SUCCESS, FAILURE, RUNNING, INVALID = (
    Status.SUCCESS,
    Status.FAILURE,
    Status.RUNNING,
    Status.INVALID,
)

Step = Callable[[], Status]
"""Ticks one node and those below it."""

Stop = Callable[[Status], None]
"""Ends one node with a status; INVALID stops it and those below it."""


class LastReport:
    """What was last told about a node, which it keeps alive."""

    __slots__ = ("message", "node", "status")

    def __init__(self, node: Behaviour) -> None:
        self.node = node
        self.status = INVALID
        self.message = ""


class Tree(Protocol):
    """What the steps and stops of a tree share."""

    @property
    def steps(self) -> Mapping[Behaviour, Step]:
        """Node → what ticks it, made at the first look."""

    @property
    def stops(self) -> Mapping[Behaviour, Stop]:
        """Node → what ends it, made at the first look."""

    @property
    def noted(self) -> list[Behaviour]:
        """Nodes that were stopped, or left out at a new start, and not ticked since.

        They and those below them may have changed without an answer.
        """

    @property
    def silent(self) -> set[Behaviour]:
        """Leaves that do nothing when they are stopped; only their status changes."""

    def told(self, node: Behaviour) -> LastReport | None:
        """Return what was last told about a node; None when nothing is to be told."""

    def look(self, node: Behaviour, told: LastReport, *, again: bool = False) -> None:
        """Tell a node if it has changed since, or ``again`` in any case."""


def method_of(node: object, name: str) -> Any:
    """Return the function behind a method of a node, which says from which class it is."""
    method = getattr(node, name)
    return getattr(method, "__func__", method)


def own(node: Behaviour, name: str) -> Any:
    """Return a method of a node that does something; None for one that does nothing."""
    return None if method_of(node, name) is getattr(Behaviour, name) else getattr(node, name)


def can_be_keys(node: Behaviour) -> bool:
    """Return whether a node and its children are told apart by who they are."""
    plain: object = object.__hash__
    return all(type(one).__hash__ is plain for one in (node, *node.children))


def leaf_stop(node: Behaviour, tree: Tree) -> Stop:
    """As ``Behaviour.stop``."""
    terminate = own(node, "terminate")
    if terminate is None:
        tree.silent.add(node)

    def stop(status: Status) -> None:
        if terminate is not None:
            terminate(status)
        node.status = status

    return stop


def composite_stop(node: Any, tree: Tree) -> Stop:
    """As ``Composite.stop``."""
    stops, silent = tree.stops, tree.silent
    terminate = own(node, "terminate")

    def stop(status: Status) -> None:
        if status is INVALID:
            node.current_child = None
            for child in node.children:
                if child.status is not INVALID:
                    if child in silent:
                        child.status = INVALID
                    else:
                        stops[child](INVALID)
        if terminate is not None:
            terminate(status)
        node.status = status

    return stop


def parallel_stop(node: Any, tree: Tree) -> Stop:
    """As ``Parallel.stop``."""
    stops, noted = tree.stops, tree.noted
    end = composite_stop(node, tree)

    def stop(status: Status) -> None:
        for child in node.children:
            if child.status is RUNNING:
                stops[child](INVALID)
                noted.append(child)
        end(status)

    return stop


def decorator_stop(node: Any, tree: Tree) -> Stop:
    """As ``Decorator.stop``."""
    stops, noted = tree.stops, tree.noted
    terminate = own(node, "terminate")

    def stop(status: Status) -> None:
        if terminate is not None:
            terminate(status)
        child = node.decorated
        if status is INVALID:
            stops[child](INVALID)
            noted.append(child)
        if child.status is RUNNING:
            stops[child](INVALID)
            noted.append(child)
        node.status = status

    return stop


STOPS: Mapping[object, Callable[[Any, Tree], Stop]] = {
    Behaviour.stop: leaf_stop,
    Composite.stop: composite_stop,
    Sequence.stop: composite_stop,
    Selector.stop: composite_stop,
    Parallel.stop: parallel_stop,
    Decorator.stop: decorator_stop,
}
"""The ``stop`` of a class → what makes the same for one of its nodes."""


def stop_of(node: Behaviour, tree: Tree) -> Stop:
    """Return what ends a node as its own ``stop`` does, or that."""
    maker = STOPS.get(method_of(node, "stop"))
    return maker(node, tree) if maker is not None and can_be_keys(node) else _unknown(node, tree)


def _unknown(node: Behaviour, tree: Tree) -> Stop:
    def stop(status: Status) -> None:
        node.stop(status)
        tree.noted.extend(node.children)

    return stop
