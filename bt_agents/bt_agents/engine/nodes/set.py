# SPDX-License-Identifier: Apache-2.0
"""Set: gives names values."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.leaf import Leaf
from bt_agents.engine.light_behaviour import SUCCESS
from bt_agents.engine.scope import Scope
from bt_agents_language.model.specs import NodeSpec


class Set(Leaf):
    """Gives names values, one after the other; always SUCCESS."""

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild | None = None
    ) -> None:
        super().__init__(spec, context, scope, build)
        scope.declare(spec.fields)

    def step(self) -> Status:
        for name in self.spec.fields:
            self.scope.write(name, self.fields.value(name))
        return SUCCESS


BEHAVIOURS = {"set": Set}
