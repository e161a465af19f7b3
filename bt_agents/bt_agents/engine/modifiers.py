# SPDX-License-Identifier: Apache-2.0
"""Modifiers: decorators written as a key beside the node, and those that change how it ends."""

from __future__ import annotations

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator

from bt_agents.engine.context import RunContext
from bt_agents.engine.fields import NodeFields
from bt_agents.engine.halting import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.leaves import Leaf
from bt_agents.engine.light_behaviour import LightBehaviour
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticking import CallTicked, Ticker
from bt_agents_language.model.specs import NodeSpec


class NodeDecorator(CallTicked, Decorator, LightBehaviour):
    """A decorator made from a spec; whatever it raises is a FAILURE that says where and why.

    As it stands it passes on the status of its node; subclasses override :meth:`decide`, and
    :meth:`bypass` where the node is not always ticked.
    """

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, child: Behaviour
    ) -> None:
        Decorator.__init__(self, spec.name, child)
        self.spec = spec
        self.context = context
        self.fields = NodeFields(spec=spec, names=scope)

    def bypass(self) -> Status | None:
        """Return the status if the node is not to be ticked; None when it is.

        RUNNING lets the node be as it is. With an end it is dropped: stopped, also if it has ended
        itself, as how it ended has no say in what comes now.
        """
        return None

    def decide(self) -> Status:
        """Return the status after the node was ticked; may raise."""
        return self.decorated.status

    def turn(self, tree: Ticker) -> Status:
        """Tick the node unless it is bypassed, and decide; an error is a FAILURE."""
        status = self.bypass()
        if status is RUNNING:
            return status
        if status is None:
            if self.status is not RUNNING:
                self.initialise()
            tree.tick_child(self.decorated)
            self.feedback_message = ""
            try:
                return self.decide()
            except Exception as error:
                status = self.fail(reason_of(error))
        tree.drop_child(self.decorated)
        return status

    def fail(self, reason: str) -> Status:
        """Note the reason and return FAILURE."""
        self.feedback_message = with_location(reason, self.spec)
        return FAILURE


class While(NodeDecorator):
    """FAILURE as soon as the condition is not true; it is looked at at each tick, before the node.

    A condition whose value is missing is not true.
    """

    def bypass(self) -> Status | None:
        """Look at the condition."""
        reason = self._obstacle()
        return self.fail(reason) if reason else None

    def _obstacle(self) -> str:
        try:
            if self.fields.holds("condition"):
                return ""
        except Exception as error:
            return reason_of(error)
        verb = "not so any more" if self.status is RUNNING else "not so"
        return self.fields.not_so("condition", verb=verb)


class Timeout(NodeDecorator):
    """FAILURE when the node runs longer than a time, on the tree's clock; it may be tuned."""

    _start = 0.0

    def initialise(self) -> None:
        """Note the start."""
        self._start = self.context.clock()

    def decide(self) -> Status:
        """Look at the clock."""
        if self.decorated.status is not RUNNING:
            return self.decorated.status
        limit = self.fields.seconds("limit")
        if self.context.reached(self.spec.path, self._start + limit):
            return self.fail(f"not done within {limit:g} s{self._missing()}")
        return RUNNING

    def _missing(self) -> str:
        """Return what the node still waits for, as far as it says so."""
        tip = self.decorated.tip()
        words = tip.missing() if isinstance(tip, Leaf) else ""
        return f": {words}" if words else ""


class Invert(NodeDecorator):
    """SUCCESS for FAILURE and FAILURE for SUCCESS."""

    def decide(self) -> Status:
        """Turn the status round."""
        status = self.decorated.status
        if status is SUCCESS:
            return self.fail("succeeded, and is inverted")
        return SUCCESS if status is FAILURE else status


class Succeed(NodeDecorator):
    """SUCCESS however the node ends."""

    def decide(self) -> Status:
        """Turn a FAILURE round."""
        status = self.decorated.status
        return SUCCESS if status is FAILURE else status


class Fail(NodeDecorator):
    """FAILURE however the node ends."""

    def decide(self) -> Status:
        """Turn a SUCCESS round."""
        if self.decorated.status is SUCCESS:
            return self.fail("succeeded, and counts as failed")
        return self.decorated.status
