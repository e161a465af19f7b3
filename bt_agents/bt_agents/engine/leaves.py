# SPDX-License-Identifier: Apache-2.0
"""The leaves of a tree, and those that only look, remember and note."""

from __future__ import annotations

from typing import ClassVar

from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.fields import NodeFields
from bt_agents.engine.light_behaviour import LightBehaviour
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.scope import Scope
from bt_agents_language.model.specs import NodeSpec


class Leaf(LightBehaviour):
    """A leaf made from a spec; whatever it raises is a FAILURE that says where and why.

    Subclasses override :meth:`begin`, :meth:`step` and :meth:`end`, each of which may raise.

    Attributes:
        acts: True when it does something outside of the tree, so that each of its ends is told,
            even when it ends twice in the same way.
    """

    acts: ClassVar[bool] = False

    def __init__(self, spec: NodeSpec, context: RunContext, scope: Scope) -> None:
        super().__init__(spec.name)
        self.spec = spec
        self.context = context
        self.scope = scope
        self.fields = NodeFields(spec=spec, names=scope)
        self._fault = ""

    def begin(self) -> None:
        """Start: called at the first tick."""

    def step(self) -> Status:
        """Go on: called at every tick, the first included."""
        raise NotImplementedError

    def missing(self) -> str:
        """Return what it still waits for, as far as it can be said."""
        return ""

    def end(self) -> None:
        """Leave nothing under way: called whenever it ends, maybe without having begun."""

    def initialise(self) -> None:
        """Begin, keeping any error for :meth:`update`."""
        self._fault = ""
        try:
            self.begin()
        except Exception as error:
            self._fault = reason_of(error)

    def update(self) -> Status:
        """Step; an error is a FAILURE."""
        self.feedback_message = ""
        if not self._fault:
            try:
                return self.step()
            except Exception as error:
                self._fault = reason_of(error)
        self.feedback_message = with_location(self._fault, self.spec)
        return Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        """End."""
        try:
            self.end()
        except Exception as error:
            self.feedback_message = with_location(reason_of(error), self.spec)


class Check(Leaf):
    """SUCCESS when the condition is true, FAILURE when it is false or not known."""

    def step(self) -> Status:
        """Look at the condition."""
        if self.fields.holds("condition"):
            return Status.SUCCESS
        self.feedback_message = self.fields.not_so("condition")
        return Status.FAILURE


class Set(Leaf):
    """Gives names values, one after the other."""

    def step(self) -> Status:
        """Write."""
        for name in self.spec.fields:
            self.scope.write(name, self.fields.value(name))
        return Status.SUCCESS


class Log(Leaf):
    """Writes a line into the log; whoever watches the run sees it as the node's message."""

    acts = True

    def step(self) -> Status:
        """Write."""
        text = str(self.fields.value("message"))
        self.context.log(str(self.fields.constant("level", "info")), text)
        self.feedback_message = text
        return Status.SUCCESS
