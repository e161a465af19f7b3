# SPDX-License-Identifier: Apache-2.0
"""Trees on which engines are compared, made of nodes that every engine has."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Kind(Enum):
    """Kind of a node."""

    SEQUENCE = "sequence"
    SELECTOR = "selector"
    INVERT = "invert"
    LEAF = "leaf"


class Answer(Enum):
    """Answer of a leaf, or of a tree, to a tick."""

    SUCCESS = "success"
    FAILURE = "failure"
    RUNNING = "running"


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A node and its descendants.

    Attributes:
        kind: Kind of the node.
        children: Its children.
        memory: Whether a composite continues at the running child instead of its first one.
        answer: A leaf's answer to every tick.
    """

    kind: Kind
    children: tuple[Shape, ...] = ()
    memory: bool = True
    answer: Answer = Answer.SUCCESS


SUCCESS = Shape(kind=Kind.LEAF, answer=Answer.SUCCESS)
FAILURE = Shape(kind=Kind.LEAF, answer=Answer.FAILURE)
RUNNING = Shape(kind=Kind.LEAF, answer=Answer.RUNNING)


def sequence(*children: Shape, memory: bool = True) -> Shape:
    """Return a node that ticks its children until one does not succeed."""
    return Shape(kind=Kind.SEQUENCE, children=children, memory=memory)


def selector(*children: Shape) -> Shape:
    """Return a node that ticks its children until one does not fail."""
    return Shape(kind=Kind.SELECTOR, children=children)


def inverted(shape: Shape, times: int) -> Shape:
    """Return a node with this many inverters around it."""
    for _ in range(times):
        shape = Shape(kind=Kind.INVERT, children=(shape,))
    return shape


def balanced(nodes: int, width: int, last: Shape) -> Shape:
    """Return sequences of sequences with a total number of nodes, filled level by level.

    Args:
        nodes: Total number.
        width: Most children of a node.
        last: The last leaf; the others succeed.
    """

    def node(number: int) -> Shape:
        below = range(number * width + 1, min(number * width + width + 1, nodes))
        if below:
            return sequence(*map(node, below))
        return last if number == deepest else SUCCESS

    deepest = 0
    while deepest * width + 1 < nodes:
        deepest = min(deepest * width + width, nodes - 1)
    return node(0)


THOUSAND = 1000
"""Nodes of the large reference tree."""

TREES = {
    "a: sequence of 10 successes": sequence(*[SUCCESS] * 10),
    "b: selector of 3 selectors of 10": selector(
        *[selector(*[FAILURE] * 10)] * 2, selector(*[FAILURE] * 9, SUCCESS)
    ),
    "c: 1,000 nodes, balanced": balanced(THOUSAND, 10, SUCCESS),
    "d: 50 nested decorators": inverted(SUCCESS, 50),
    "e: memory sequence, 10th leaf running": sequence(*[SUCCESS] * 9, RUNNING),
    "f: guarded running leaf": sequence(SUCCESS, RUNNING, memory=False),
}
"""The reference trees by name."""
