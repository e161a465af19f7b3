# SPDX-License-Identifier: Apache-2.0
"""Other behaviour-tree engines, each building the same trees in its own way, without debugging.

In every engine, the leaves are plain Python and count their ticks.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from engines import Built
from reference_trees import Answer, Kind, Shape


@dataclass(kw_only=True)
class Counted:
    """A leaf's answer in the terms of its engine, and the number of its ticks."""

    answer: Any
    ticks: int = 0


def behaviortree_cpp(shape: Shape) -> Built:
    """BehaviorTree.CPP through its Python binding: a tree from XML, with registered leaves."""
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
    """bonsai-bt, in Rust: one callback for all leaves; a tree that has ended is reset."""
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


@dataclass(frozen=True, kw_only=True)
class Peer:
    """Another engine.

    Attributes:
        module: Its Python module.
        build: Builds a tree.
    """

    module: str
    build: Callable[[Shape], Built]

    @property
    def is_installed(self) -> bool:
        """Whether it can be imported."""
        return importlib.util.find_spec(self.module) is not None


CPP = "BehaviorTree.CPP"

PEERS = {
    CPP: Peer(module="behaviortreepy", build=behaviortree_cpp),
    "bonsai-bt": Peer(module="bonsai_bt", build=bonsai),
}
"""Peers by name; all are optional."""
