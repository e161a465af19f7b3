# SPDX-License-Identifier: Apache-2.0
"""Other behaviour-tree engines, each building the same trees in its own way, no debugging on.

The leaves are plain Python that counts how often it was ticked, in every engine.
"""

from __future__ import annotations

import asyncio
import importlib.util
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from engines import Built
from reference_trees import Answer, Kind, Shape


class NotTheirsError(Exception):
    """An engine cannot express a tree; says why."""


@dataclass(kw_only=True)
class Counted:
    """A leaf's answer in the words of its engine, and how often it was ticked."""

    answer: Any
    ticks: int = 0


def behaviortreepy(shape: Shape) -> Built:
    """BehaviorTree.CPP through its binding: the tree from XML, the leaves registered."""
    import behaviortreepy as bt

    factory = bt.BehaviorTreeFactory()
    leaves: list[Counted] = []

    def element(shape: Shape) -> str:
        if shape.kind is Kind.LEAF:
            return _registered(factory, leaves, bt.NodeStatus, shape.answer)
        name = {
            Kind.INVERT: "Inverter",
            Kind.SEQUENCE: "Sequence" if shape.memory else "ReactiveSequence",
            Kind.SELECTOR: "Fallback" if shape.memory else "ReactiveFallback",
        }[shape.kind]
        return f"<{name}>{''.join(map(element, shape.children))}</{name}>"

    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{element(shape)}</BehaviorTree></root>'
    tree = factory.create_tree_from_text(text)
    means = {bt.NodeStatus.__members__[answer.name]: answer for answer in Answer}
    return Built(tick=tree.tick_exactly_once, means=means, leaves=leaves)


def _registered(factory: Any, leaves: list[Counted], statuses: Any, answer: Answer) -> str:
    leaf = Counted(answer=statuses.__members__[answer.name])
    leaves.append(leaf)
    name = f"Leaf{len(leaves)}"

    def tick(node: object) -> object:
        leaf.ticks += 1
        return leaf.answer

    if answer is Answer.RUNNING:
        factory.register_simple_stateful_action(name, tick, tick)
    else:
        factory.register_simple_action(name, tick)
    return f"<{name}/>"


def bonsai(shape: Shape) -> Built:
    """bonsai-bt, in Rust: one callback for all leaves; a tree that ended is reset."""
    import bonsai_bt as bt

    leaves: list[Counted] = []

    def node(shape: Shape) -> Any:
        if shape.kind is Kind.LEAF:
            status = getattr(bt.Status, shape.answer.name.capitalize())
            leaves.append(Counted(answer=(status, 0.0)))
            return bt.Action(leaves[-1])
        children = [node(child) for child in shape.children]
        if shape.kind is Kind.INVERT:
            return bt.Invert(children[0])
        kind = bt.Sequence if shape.kind is Kind.SEQUENCE else bt.Select
        return kind(children, memory=shape.memory)

    def call(args: Any, board: None) -> Any:
        leaf = args.action
        leaf.ticks += 1
        return leaf.answer

    tree = bt.BT(node(shape), None)

    def tick() -> Any:
        status, _ = tree.tick(0.0, call)
        if tree.is_finished():
            tree.reset_bt()
        return status

    means = {getattr(bt.Status, answer.name.capitalize()): answer for answer in Answer}
    return Built(tick=tick, means=means, leaves=leaves)


def bteng(shape: Shape) -> Built:
    """Bteng, in Python: its engine without tracer and inspector."""
    from bteng.core.engine import BehaviorTreeEngine
    from bteng.core.node import NodeStatus
    from bteng.nodes.control.fallback import FallbackNode
    from bteng.nodes.control.reactive_fallback import ReactiveFallbackNode
    from bteng.nodes.control.reactive_sequence import ReactiveSequenceNode
    from bteng.nodes.control.sequence import SequenceNode
    from bteng.nodes.decorators.inverter import Inverter as TheirInverter
    from bteng.nodes.leaf.action import ActionNode

    class Leaf(ActionNode):  # type: ignore[misc]
        def __init__(self, answer: Any) -> None:
            super().__init__("leaf")
            self.answer = answer
            self.ticks = 0

        def tick(self) -> Any:
            self.ticks += 1
            return self.answer

    leaves: list[Any] = []

    def node(shape: Shape) -> Any:
        if shape.kind is Kind.LEAF:
            leaves.append(Leaf(NodeStatus[shape.answer.name]))
            return leaves[-1]
        children = [node(child) for child in shape.children]
        if shape.kind is Kind.INVERT:
            return TheirInverter(child=children[0])
        if shape.kind is Kind.SEQUENCE:
            return (SequenceNode if shape.memory else ReactiveSequenceNode)(children=children)
        return (FallbackNode if shape.memory else ReactiveFallbackNode)(children=children)

    engine = BehaviorTreeEngine(node(shape))
    means = {NodeStatus[answer.name]: answer for answer in Answer}
    return Built(tick=engine.tick_once, means=means, leaves=leaves)


def btreeny(shape: Shape) -> Built:
    """Btreeny, in Python: a tree that ends is used up, so it is made anew for each tick."""
    import btreeny as bt

    leaves: list[Counted] = []
    make = _btreeny_maker(bt, shape, leaves)
    means = {bt.TreeStatus[answer.name]: answer for answer in Answer}
    if any(leaf.answer is Answer.RUNNING for leaf in shape.leaves):
        resources = ExitStack()
        tick = resources.enter_context(make())
        return Built(tick=lambda: tick(None), means=means, leaves=leaves, resources=resources)

    @bt.runner
    def tick_new() -> Any:
        with make() as tick:
            return tick(None)

    return Built(tick=tick_new, means=means, leaves=leaves)


def _btreeny_maker(bt: Any, shape: Shape, leaves: list[Counted]) -> Callable[[], Any]:
    """Return what makes the node of a shape, anew each time."""
    if shape.kind is Kind.LEAF:
        leaf = Counted(answer=bt.TreeStatus[shape.answer.name])
        leaves.append(leaf)

        def call(board: None) -> Any:
            leaf.ticks += 1
            return leaf.answer

        return bt.simple_action(call)
    if shape.kind is Kind.SEQUENCE and not shape.memory:
        return _btreeny_guarded(bt, shape, leaves)
    makers = [_btreeny_maker(bt, child, leaves) for child in shape.children]
    if shape.kind is Kind.INVERT:
        succeeded, failed = bt.TreeStatus.SUCCESS, bt.TreeStatus.FAILURE
        return lambda: bt.swap(makers[0](), from_=succeeded, to=failed)
    composite = bt.sequential if shape.kind is Kind.SEQUENCE else bt.fallback
    return lambda: composite(*[maker() for maker in makers])


def _btreeny_guarded(bt: Any, shape: Shape, leaves: list[Counted]) -> Callable[[], Any]:
    """Return what makes its ``failsafe``, a function that is asked before each tick of a child."""
    guard, child = shape.children
    leaf = Counted(answer=guard.answer is Answer.SUCCESS)
    leaves.append(leaf)

    def check(board: None) -> bool:
        leaf.ticks += 1
        return leaf.answer

    nominal = _btreeny_maker(bt, child, leaves)
    otherwise = bt.simple_action(lambda board: bt.TreeStatus.FAILURE)
    return lambda: bt.failsafe(check, nominal(), otherwise())


def async_btree(shape: Shape) -> Built:
    """async-btree, coroutines: all ticks in one event loop."""
    import async_btree as bt

    if any(leaf.answer is Answer.RUNNING for leaf in shape.leaves):
        raise NotTheirsError("async-btree awaits the end of a leaf: it has no status for running")
    leaves: list[Counted] = []

    def node(shape: Shape) -> Any:
        if shape.kind is Kind.LEAF:
            leaf = Counted(answer=shape.answer is Answer.SUCCESS)
            leaves.append(leaf)

            async def tick() -> bool:
                leaf.ticks += 1
                return leaf.answer

            return tick
        children = [node(child) for child in shape.children]
        if shape.kind is Kind.INVERT:
            return bt.inverter(children[0])
        return (bt.sequence if shape.kind is Kind.SEQUENCE else bt.fallback)(children)

    root = node(shape)

    async def tick() -> bool:
        return bool(await root())

    means = {True: Answer.SUCCESS, False: Answer.FAILURE}
    return _in_a_loop(Built(tick=tick, means=means, leaves=leaves))


def abtree(shape: Shape) -> Built:
    """Abtree, coroutines: ticked by its tick manager as it does itself, in one event loop."""
    import abtree as bt

    class Leaf(bt.Action):  # type: ignore[misc]
        def __init__(self, answer: Any) -> None:
            super().__init__("leaf")
            self.answer = answer
            self.ticks = 0

        async def execute(self) -> Any:
            self.ticks += 1
            return self.answer

    if shape.memory and any(leaf.answer is Answer.RUNNING for leaf in shape.leaves):
        raise NotTheirsError("abtree's sequence has no memory")
    leaves: list[Any] = []

    def node(shape: Shape) -> Any:
        if shape.kind is Kind.LEAF:
            leaves.append(Leaf(bt.Status[shape.answer.name]))
            return leaves[-1]
        children = [node(child) for child in shape.children]
        if shape.kind is Kind.INVERT:
            return bt.Inverter("invert", children[0])
        return (bt.Sequence if shape.kind is Kind.SEQUENCE else bt.Selector)("", children)

    async def tree() -> Any:
        made = bt.BehaviorTree()
        made.load_from_node(node(shape))
        return made

    built = _in_a_loop(
        Built(
            tick=lambda: None,
            means={bt.Status[answer.name]: answer for answer in Answer},
            leaves=leaves,
        )
    )
    assert built.runner is not None
    built.tick = built.runner.run(tree()).tick_manager.tick_once
    return built


def _in_a_loop(built: Built) -> Built:
    built.runner = built.resources.enter_context(asyncio.Runner())
    return built


@dataclass(frozen=True, kw_only=True)
class Peer:
    """Another engine.

    Attributes:
        module: Its Python module.
        build: Builds a tree; raises :class:`NotTheirsError` when it cannot.
    """

    module: str
    build: Callable[[Shape], Built]

    @property
    def is_installed(self) -> bool:
        """Whether it can be imported."""
        return importlib.util.find_spec(self.module) is not None


CPP = "BehaviorTree.CPP"

PEERS = {
    CPP: Peer(module="behaviortreepy", build=behaviortreepy),
    "bonsai-bt": Peer(module="bonsai_bt", build=bonsai),
    "bteng": Peer(module="bteng", build=bteng),
    "btreeny": Peer(module="btreeny", build=btreeny),
    "async-btree": Peer(module="async_btree", build=async_btree),
    "abtree": Peer(module="abtree", build=abtree),
}
"""By name; none of them has to be installed."""
