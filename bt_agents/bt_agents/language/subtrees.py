# SPDX-License-Identifier: Apache-2.0
"""Subtrees put in place of the nodes that call them; recursion and sheer size are refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from bt_agents.language.shape import FileReading
from bt_agents.language.specs import NodeSpec, Position

MAX_NODES = 2000
"""Nodes of all trees of an agent, modifiers counted, subtrees counted wherever they are used."""

MAX_DEPTH = 64
"""Nesting of nodes, modifiers and subtrees counted."""


class Expansion:
    """Puts subtrees in place.

    Args:
        reading: The file, for problems.
        bodies: The tree of each subtree; its paths start with the subtree's name.
        calls: Place of each ``subtree`` node → name of the subtree.
    """

    def __init__(
        self,
        reading: FileReading,
        bodies: Mapping[str, NodeSpec],
        calls: Mapping[Position, str],
    ) -> None:
        self._reading = reading
        self._bodies = bodies
        self._calls = calls
        self._sizes: dict[str, tuple[int, int]] = {}

    def refuse_recursion(self) -> bool:
        """Report every subtree that contains itself; return whether there is one."""
        called = {name: self._called(body) for name, body in self._bodies.items()}
        found = False
        finished: set[str] = set()
        for start in self._bodies:
            chain = [start]
            iterators = [iter(called[start].items())]
            while iterators:
                name, position = next(iterators[-1], (None, None))
                if name is None or position is None:
                    iterators.pop()
                    finished.add(chain.pop())
                elif name in chain:
                    found = True
                    loop = " → ".join([*chain[chain.index(name) :], name])
                    self._reading.error(
                        "recursion",
                        position,
                        f"subtree '{name}' contains itself: {loop[:200]}",
                        "use 'repeat' to do something again",
                    )
                elif name not in finished:
                    chain.append(name)
                    iterators.append(iter(called[name].items()))
        return found

    def expand(self, root: NodeSpec, budget: int = MAX_NODES) -> tuple[NodeSpec, int] | None:
        """Return a tree with its subtrees in place and its number of nodes.

        Returns:
            None when it is too large or too deep, which is then reported.
        """
        size, depth = self._size(root)
        if size > budget or depth > MAX_DEPTH:
            found = f"{size} nodes" if size > budget else f"{depth} levels"
            self._reading.error(
                "tree-too-large",
                root.position,
                f"the tree has {found} with its subtrees, at most {MAX_NODES} nodes in "
                f"{MAX_DEPTH} levels are possible",
                "use 'repeat', or split the agent",
            )
            return None
        return self._expanded(root, ""), size

    def _called(self, body: NodeSpec) -> dict[str, Position]:
        """Return the subtrees that a tree calls itself, each with the place of one call."""
        found: dict[str, Position] = {}
        open_specs = [body]
        while open_specs:
            spec = open_specs.pop()
            open_specs += spec.children
            name = self._calls.get(spec.position) if spec.kind == "subtree" else None
            if name is not None and name in self._bodies:
                found.setdefault(name, spec.position)
        return found

    def _size(self, spec: NodeSpec) -> tuple[int, int]:
        """Return how many nodes and levels a tree has with its subtrees in place."""
        sizes = [self._size(child) for child in spec.children]
        if spec.kind == "subtree":
            name = self._calls[spec.position]
            if name in self._bodies:
                if name not in self._sizes:
                    self._sizes[name] = self._size(self._bodies[name])
                sizes.append(self._sizes[name])
        return 1 + sum(s for s, _ in sizes), 1 + max((d for _, d in sizes), default=0)

    def _expanded(self, spec: NodeSpec, prefix: str) -> NodeSpec:
        path = prefix + spec.path
        children = tuple(self._expanded(child, prefix) for child in spec.children)
        if spec.kind == "subtree":
            body = self._bodies.get(self._calls[spec.position])
            if body is not None:
                children = (self._expanded(body, f"{path}/"),)
        return replace(spec, path=path, children=children)
