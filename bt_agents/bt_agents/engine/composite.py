# SPDX-License-Identifier: Apache-2.0
"""Base classes of the composites: nodes with several children."""

from __future__ import annotations

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.fields import NodeFields
from bt_agents.engine.light_behaviour import FAILURE, INVALID, RUNNING
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticker import CallTicked, Ticker
from bt_agents_language.model.specs import NodeSpec


class Composite(CallTicked, composites.Composite):
    """A composite built from a spec.

    Attributes:
        current_child: The child that decides the status; None for none.
    """

    status: Status
    current_child: Behaviour | None

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        super().__init__(spec.name, [build(child, scope) for child in spec.children])
        self.spec = spec
        self.fields = NodeFields(spec=spec, names=scope)
        self.current_child = None

    def stop(self, new_status: Status) -> None:
        super().stop(new_status)
        if new_status is INVALID:
            self.current_child = None


class InOrder(Composite):
    """Base of composites that tick their children in order.

    Attributes:
        memory: Whether they continue at the running child instead of the first one.
    """

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        super().__init__(spec, context, scope, build)
        self.memory = bool(self.fields.constant("memory", True))


class ChooseOne(Composite):
    """Base of composites that pick one child when they start and end as it does.

    An error while picking is a FAILURE.
    """

    def pick(self) -> Behaviour:
        """Return the child to tick, and name it in the message; may raise."""
        raise NotImplementedError

    def tick_children(self, ticker: Ticker) -> Status:
        if self.status is not RUNNING:
            for child in self.children:
                ticker.reset_child(child)
            try:
                self.current_child = self.pick()
            except Exception as error:
                self.current_child = None
                self.feedback_message = with_location(reason_of(error), self.spec)
        return FAILURE if self.current_child is None else ticker.tick_child(self.current_child)
