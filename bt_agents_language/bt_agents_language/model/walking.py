# SPDX-License-Identifier: Apache-2.0
"""Every node of a tree, whatever its nodes are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, Self, TypeVar


class _Parent(Protocol):
    @property
    def children(self) -> tuple[Self, ...]: ...


_Node = TypeVar("_Node", bound=_Parent)


def iter_nodes(root: _Node) -> Iterator[_Node]:
    """Return a node and all nodes below it, parents before children."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        yield node
        if node.children:
            waiting += reversed(node.children)
