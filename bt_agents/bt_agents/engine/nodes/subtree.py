# SPDX-License-Identifier: Apache-2.0
"""Subtree: a tree with its own names; the caller sees only the declared outputs."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Decorator
from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.light_behaviour import RUNNING
from bt_agents.engine.scope import Scope, SubtreeScope
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.specs import NodeSpec


class Subtree(Decorator):
    """Ends as its tree does; each start forgets the values of earlier ones.

    An output without a value leaves the caller's name unchanged.
    """

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        self.scope = scope
        self.changes_values = bool(spec.outputs)
        self._inside = SubtreeScope(
            inputs={k: v for k, v in spec.fields.items() if not isinstance(v, Expression)},
            caller=scope,
            run=context.scope,
        )
        super().__init__(spec, context, scope, lambda child, _: build(child, self._inside))

    def initialise(self) -> None:
        self._inside.written.clear()

    def decide(self) -> Status:
        status = self.decorated.status
        if status is not RUNNING:
            for name, inner in self.spec.outputs.items():
                if inner not in self._inside.written:
                    continue
                value = self._inside.written[inner]
                if self.scope.write(name, value):
                    self.note_change(name, value)
        return status


BEHAVIOURS = {"subtree": Subtree}
