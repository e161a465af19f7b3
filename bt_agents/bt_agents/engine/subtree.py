# SPDX-License-Identifier: Apache-2.0
"""Subtrees: trees with names of their own, of which the caller sees the declared outputs."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.modifiers import NodeDecorator
from bt_agents.engine.scope import Scope, SubtreeScope
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.specs import NodeSpec


class Subtree(NodeDecorator):
    """Ends as its tree does; each start forgets what an earlier one has written.

    An output to which nothing was written leaves the caller's name as it is.
    """

    def __init__(
        self,
        spec: NodeSpec,
        context: RunContext,
        caller: Scope,
        inside: SubtreeScope,
        tree: Behaviour,
    ) -> None:
        super().__init__(spec, context, caller, tree)
        self._caller = caller
        self._inside = inside

    def initialise(self) -> None:
        """Forget."""
        self._inside.written.clear()

    def decide(self) -> Status:
        """Hand over the outputs when it ends."""
        status = self.decorated.status
        if status is not Status.RUNNING:
            for name, inner in self.spec.outputs.items():
                if inner in self._inside.written:
                    self._caller.write(name, self._inside.written[inner])
        return status


def subtree_scope(spec: NodeSpec, context: RunContext, caller: Scope) -> SubtreeScope:
    """Return the names inside the subtree that a node calls."""
    return SubtreeScope(
        inputs={k: v for k, v in spec.fields.items() if not isinstance(v, Expression)},
        caller=caller,
        run=context.scope,
        own=frozenset(name for child in spec.children for name in _written(child)),
    )


def _written(spec: NodeSpec) -> Iterator[str]:
    """Give the names that the nodes of a tree write, without those inside of its subtrees."""
    yield from spec.outputs
    if spec.kind == "set":
        yield from spec.fields
    if spec.kind != "subtree":
        for child in spec.children:
            yield from _written(child)
