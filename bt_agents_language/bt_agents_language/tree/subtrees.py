# SPDX-License-Identifier: Apache-2.0
"""Expansion of subtrees in place of their calls; refuses recursion and excessive size."""

from __future__ import annotations

import operator
from collections.abc import Mapping

from bt_agents_core.diagnostic import Position
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.yaml.typed_reader import TypedReader

MAX_NODES = 10_000
"""Most nodes of all trees of an agent, including decorators and every use of a subtree."""

MAX_DEPTH = 64
"""Maximum nesting of nodes, including decorators and subtrees."""


class Expansion:
    """Expander of subtrees.

    Args:
        bodies: The tree of each callable subtree, where imported ones are already expanded; its
            paths start with the subtree's name.
        calls: Place of each ``subtree`` node → name of the subtree.
    """

    def __init__(
        self, reading: TypedReader, bodies: Mapping[str, NodeSpec], calls: Mapping[Position, str]
    ) -> None:
        self._reading = reading
        self._bodies = bodies
        self._calls = calls
        self._sizes: dict[str, tuple[int, int]] = {}

    def refuse_recursion(self) -> bool:
        """Report every subtree that contains itself; return whether there is one.

        Subtrees are finished and measured after all that they call, in chains of any length.
        """
        called = {name: self._called(body) for name, body in self._bodies.items()}
        found = False
        finished: set[str] = set()
        for start in self._bodies:
            if start in finished:
                continue
            # The subtrees that lead to the current one, each with the calls still to follow.
            chain = {start: iter(called[start].items())}
            while chain:
                current, calls = next(reversed(chain.items()))
                name, position = next(calls, ("", None))
                if position is None:
                    del chain[current]
                    finished.add(current)
                    self._sizes[current] = self._size(self._bodies[current])
                elif name in chain:
                    found = True
                    names = list(chain)
                    loop = " → ".join([*names[names.index(name) :], name])
                    self._reading.error(
                        "recursion",
                        position,
                        f"subtree '{name}' contains itself: {loop[:90]}",
                        "use 'repeat' to do something again",
                    )
                elif name not in finished:
                    chain[name] = iter(called[name].items())
        return found

    def expand(
        self, root: NodeSpec | None, budget: int = MAX_NODES
    ) -> tuple[NodeSpec | None, int]:
        """Return a tree with expanded subtrees, and its number of nodes.

        The tree is None for no tree, and after a report for one that is too large or too deep.
        """
        if root is None:
            return None, 0
        size, depth = self._size(root)
        if size > budget or depth > MAX_DEPTH:
            limit = f"{MAX_NODES:,} nodes" if size > budget else f"{MAX_DEPTH} levels"
            self._reading.error(
                "tree-too-large",
                root.position,
                f"the trees of this agent have more than {limit}, subtrees counted wherever they "
                "are used",
                "use 'repeat', or split the agent",
            )
            return None, 0
        return (self._expanded(root, "") if self._calls else root), size

    def _called(self, body: NodeSpec) -> dict[str, Position]:
        """Return the subtrees that a tree calls itself, each with the place of one call."""
        found: dict[str, Position] = {}
        open_specs = [body]
        while open_specs:
            spec = open_specs.pop()
            open_specs += spec.children
            name = self._calls.get(spec.position) if self._is_call(spec) else None
            if name is not None and name in self._bodies:
                found.setdefault(name, spec.position)
        return found

    def _size(self, spec: NodeSpec) -> tuple[int, int]:
        """Return the numbers of nodes and levels of a tree with expanded subtrees."""
        if self._is_call(spec):
            size, depth = self._sizes.get(self._calls[spec.position], (0, 0))
            return 1 + size, 1 + depth
        size, deepest = 1, 0
        for child in spec.children:
            below, depth = self._size(child)
            size += below
            deepest = max(deepest, depth)
        return size, 1 + deepest

    def _expanded(self, spec: NodeSpec, prefix: str) -> NodeSpec:
        path = prefix + spec.path
        body = self._bodies.get(self._calls[spec.position]) if self._is_call(spec) else None
        if body is not None:
            children = [self._expanded(body, f"{path}/")]
        else:
            children = [self._expanded(child, prefix) for child in spec.children]
            if not prefix and all(map(operator.is_, children, spec.children)):
                return spec
        return spec.moved(path, tuple(children))

    def _is_call(self, spec: NodeSpec) -> bool:
        """Return whether a node calls a subtree that is not yet expanded."""
        return not spec.children and spec.position in self._calls
