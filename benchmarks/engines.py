# SPDX-License-Identifier: Apache-2.0
"""The reference trees, built and ticked by py_trees and by our engine."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Selector, Sequence
from py_trees.decorators import Inverter

from bt_agents.engine.context import BuildChild
from bt_agents.engine.light_behaviour import LightBehaviour
from bt_agents.engine.nodes.invert import Invert
from bt_agents.engine.nodes.selector import LightSelector
from bt_agents.engine.nodes.sequence import LightSequence
from bt_agents.engine.ticker import Ticker
from bt_agents_core.diagnostic import Position
from bt_agents_language.model.specs import Literal, NodeSpec
from measuring import Way, timed
from reference_trees import Answer, Kind, Shape


@dataclass(kw_only=True)
class Built:
    """A tree built for an engine.

    Attributes:
        tick: Ticks the tree once.
        means: The engine's status values and their meaning.
        leaves: Its leaves from the first to the last.
        ticked: Number of ticks so far.
        status: Returns the engine's status from the result of a tick.
    """

    tick: Callable[[], Any]
    means: dict[Any, Answer]
    leaves: list[Any]
    ticked: int = 0
    status: Callable[[Any], Any] = lambda answer: answer

    def tick_once(self) -> Answer:
        """Tick and return the status."""
        self.ticked += 1
        return self.means[self.status(self.tick())]

    def way(self, number: int) -> Way:
        """Return a measurement of some ticks back to back."""
        ticks = timed(self.tick, number, time.thread_time)

        def way() -> float:
            self.ticked += number
            return ticks()

        return way

    def counts(self) -> list[int]:
        """Return how often each leaf was ticked."""
        return [leaf.ticks for leaf in self.leaves]


class _Counting(Behaviour):
    """Leaf for both engines, written as users do: with ``update`` only."""

    def __init__(self, answer: Status) -> None:
        super().__init__("leaf")
        self.answer = answer
        self.ticks = 0

    def update(self) -> Status:
        self.ticks += 1
        return self.answer


class _LightLeaf(_Counting, LightBehaviour):
    """The same leaf with the base class of our nodes."""


PY_TREES = {
    Status.SUCCESS: Answer.SUCCESS,
    Status.FAILURE: Answer.FAILURE,
    Status.RUNNING: Answer.RUNNING,
}


def behaviours(shape: Shape) -> tuple[Behaviour, list[Any]]:
    """Return a tree of stock py_trees classes, and its leaves."""
    leaves: list[Any] = []

    def node(shape: Shape) -> Behaviour:
        if shape.kind is Kind.LEAF:
            leaves.append(_Counting(Status[shape.answer.name]))
            return leaves[-1]
        children = [node(child) for child in shape.children]
        if shape.kind is Kind.INVERT:
            return Inverter("invert", children[0])
        kind = Sequence if shape.kind is Kind.SEQUENCE else Selector
        return kind(shape.kind.value, memory=shape.memory, children=children)

    return node(shape), leaves


def py_trees(shape: Shape) -> Built:
    """Tree that py_trees ticks with its own ``tick_once``."""
    root, leaves = behaviours(shape)
    return Built(
        tick=root.tick_once, means=PY_TREES, leaves=leaves, status=lambda _answer: root.status
    )


_OURS = {Kind.SEQUENCE: LightSequence, Kind.SELECTOR: LightSelector, Kind.INVERT: Invert}


def light_behaviours(shape: Shape) -> tuple[Behaviour, list[Any]]:
    """Return a tree of our own classes, and its leaves."""
    leaves: list[Any] = []

    def node(shape: Shape) -> Behaviour:
        if shape.kind is Kind.LEAF:
            leaves.append(_LightLeaf(Status[shape.answer.name]))
            return leaves[-1]
        shapes = iter(shape.children)
        build: BuildChild = lambda _spec, _scope: node(next(shapes))  # noqa: E731
        nothing: Any = None
        spec = NodeSpec(
            path="tree",
            position=Position(file="benchmark.yaml", line=1, column=1),
            kind=shape.kind.value,
            name=shape.kind.value,
            fields={"memory": Literal(value=shape.memory)},
            children=(nothing,) * len(shape.children),
        )
        return _OURS[shape.kind](spec, nothing, nothing, build)

    return node(shape), leaves


def ours(shape: Shape) -> Built:
    """Tree of our own classes that our engine ticks."""
    root, leaves = light_behaviours(shape)
    return Built(tick=Ticker(root).tick, means=PY_TREES, leaves=leaves)


def only_leaves(shape: Shape) -> Built:
    """Loop over the leaves that a second tick calls: no engine can be faster."""
    built = py_trees(shape)
    built.tick_once()
    before = built.counts()
    built.tick_once()
    after = built.counts()
    calls = [leaf.update for leaf, a, b in zip(built.leaves, before, after, strict=True) if b > a]

    def tick() -> None:
        for call in calls:
            call()

    return Built(tick=tick, means={}, leaves=built.leaves, ticked=built.ticked)
