# SPDX-License-Identifier: Apache-2.0
"""Modifiers: decorators written as a key beside the node, and those that change how it ends."""

from __future__ import annotations

from collections.abc import Iterator

import py_trees
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.faults import located, why
from bt_agents.engine.fields import Fields
from bt_agents.engine.leaves import Leaf
from bt_agents.engine.scope import Scope
from bt_agents.language.specs import NodeSpec


class Modifier(py_trees.decorators.Decorator):
    """A decorator made from a spec; whatever it raises is a FAILURE that says where and why.

    As it stands it passes on the status of its node; subclasses override :meth:`decide`.
    """

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, child: Behaviour
    ) -> None:
        super().__init__(name=spec.name, child=child)
        self.spec = spec
        self.context = context
        self.fields = Fields(spec=spec, names=scope)

    def decide(self) -> Status:
        """Return the status after the node was ticked; may raise."""
        return self.decorated.status

    def update(self) -> Status:
        """Decide; an error is a FAILURE."""
        self.feedback_message = ""
        try:
            return self.decide()
        except Exception as error:
            self.drop()
            return self.fail(why(error))

    def fail(self, reason: str) -> Status:
        """Note the reason and return FAILURE."""
        self.feedback_message = located(reason, self.spec)
        return Status.FAILURE

    def drop(self) -> None:
        """Stop the node, also one that has ended: how it ended has no say in what comes now."""
        if self.decorated.status is not Status.INVALID:
            self.decorated.stop(Status.INVALID)


class While(Modifier):
    """FAILURE as soon as the condition is not true; it is looked at at each tick, before the node.

    A condition whose value is missing is not true.
    """

    def tick(self) -> Iterator[Behaviour]:
        """Tick the node only while the condition is true."""
        reason = self._obstacle()
        if reason:
            self.drop()
            self.stop(self.fail(reason))
            yield self
            return
        yield from super().tick()

    def _obstacle(self) -> str:
        try:
            if self.fields.holds("condition"):
                return ""
        except Exception as error:
            return why(error)
        verb = "not so any more" if self.status is Status.RUNNING else "not so"
        return self.fields.not_so("condition", verb=verb)


class Timeout(Modifier):
    """FAILURE when the node runs longer than a time, on the tree's clock; it may be tuned."""

    _start = 0.0

    def initialise(self) -> None:
        """Note the start."""
        self._start = self.context.clock()

    def decide(self) -> Status:
        """Look at the clock."""
        if self.decorated.status is not Status.RUNNING:
            return self.decorated.status
        limit = self.fields.seconds("limit")
        if self.context.reached(self.spec.path, self._start + limit):
            return self.fail(f"not done within {limit:g} s{self._missing()}")
        return Status.RUNNING

    def _missing(self) -> str:
        """Return what the node still waits for, as far as it says so."""
        tip = self.decorated.tip()
        words = tip.missing() if isinstance(tip, Leaf) else ""
        return f": {words}" if words else ""


class Invert(Modifier):
    """SUCCESS for FAILURE and FAILURE for SUCCESS."""

    def decide(self) -> Status:
        """Turn the status round."""
        match self.decorated.status:
            case Status.SUCCESS:
                return self.fail("succeeded, and is inverted")
            case Status.FAILURE:
                return Status.SUCCESS
            case status:
                return status


class Succeed(Modifier):
    """SUCCESS however the node ends."""

    def decide(self) -> Status:
        """Turn a FAILURE round."""
        status = self.decorated.status
        return Status.SUCCESS if status is Status.FAILURE else status


class Fail(Modifier):
    """FAILURE however the node ends."""

    def decide(self) -> Status:
        """Turn a SUCCESS round."""
        if self.decorated.status is Status.SUCCESS:
            return self.fail("succeeded, and counts as failed")
        return self.decorated.status
