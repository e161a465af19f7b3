# SPDX-License-Identifier: Apache-2.0
"""Base class of all decorators: nodes around one child, written as a key next to it."""

from __future__ import annotations

from py_trees import decorators
from py_trees.common import Status

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.fields import NodeFields
from bt_agents.engine.light_behaviour import FAILURE, RUNNING
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticker import CallTicked, Ticker
from bt_agents_language.expression.expressions import MissingValue
from bt_agents_language.model.specs import NodeSpec


class Decorator(CallTicked, decorators.Decorator):
    """A decorator built from a spec; its exceptions become a FAILURE that says where and why.

    The base class passes on the status of its child. Subclasses override :meth:`decide`, and
    :meth:`short_circuit` if they do not always tick the child.
    """

    status: Status

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        child = self.decorated = build(spec.children[0], scope)
        super().__init__(spec.name, [child])
        self.spec = spec
        self.context = context
        self.fields = NodeFields(spec=spec, names=scope)

    def short_circuit(self) -> Status | None:
        """Return the status that replaces a tick of the child, None to tick it; may raise.

        RUNNING leaves the child unchanged. Every other status resets it, even if it has ended by
        itself, because its result no longer matters.
        """
        return None

    def decide(self) -> Status:
        """Return the status after a tick of the child; may raise."""
        return self.decorated.status

    def tick_children(self, ticker: Ticker) -> Status:
        try:
            status = self.short_circuit()
        except Exception as error:
            status = self.fail(reason_of(error))
        if status is RUNNING:
            return status
        if status is None:
            if self.status is not RUNNING:
                self.initialise()
            ticker.tick_child(self.decorated)
            self.feedback_message = ""
            try:
                status = self.decide()
            except Exception as error:
                status = self.fail(reason_of(error))
            else:
                if status is RUNNING or self.decorated.status is not RUNNING:
                    return status
        ticker.reset_child(self.decorated)
        return status

    def why_not(self, condition: str, *, verb: str = "not so") -> str:
        """Return why a condition in a field is not true; empty when it is true.

        Raises:
            Undecided: It is neither true nor false although no value is missing.
        """
        try:
            if self.fields.is_true(condition):
                return ""
        except MissingValue as missing:
            return reason_of(missing)
        return self.fields.explain_false(condition, verb=verb)

    def fail(self, reason: str) -> Status:
        """Set the message to the reason and return FAILURE."""
        self.feedback_message = with_location(reason, self.spec)
        return FAILURE
