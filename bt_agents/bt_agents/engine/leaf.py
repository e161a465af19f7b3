# SPDX-License-Identifier: Apache-2.0
"""Base class of all leaves: errors become a FAILURE with its place in the file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from py_trees.common import Status

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.environment import GoalRun
from bt_agents.engine.fields import NodeFields
from bt_agents.engine.light_behaviour import FAILURE, LightBehaviour
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.scope import Scope
from bt_agents_core.field_types import Plain
from bt_agents_language.model.specs import NodeSpec


class Leaf(LightBehaviour):
    """A leaf built from a spec; its exceptions become a FAILURE that says where and why.

    Subclasses override :meth:`begin`, :meth:`step` and :meth:`end`, each of which may raise.

    Attributes:
        has_side_effects: True if it acts outside the tree; each of its ends is then reported,
            even if it ends the same way twice.
    """

    has_side_effects: ClassVar[bool] = False

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, _build: BuildChild | None = None
    ) -> None:
        super().__init__(spec.name)
        self.spec = spec
        self.context = context
        self.scope = scope
        self.fields = NodeFields(spec=spec, names=scope)
        self._error = ""

    def begin(self) -> None:
        """Start; called at the first tick."""

    def step(self) -> Status:
        """Continue; called at every tick, including the first."""
        raise NotImplementedError

    def write(self, name: str, value: Plain) -> None:
        """Assign a value to a name."""
        if self.scope.write(name, value):
            self.note_change(name, value)

    def tell(self, values: Mapping[str, Plain]) -> None:
        """Assign values that the scene layer has accepted to names of the scene or the person."""
        for name, value in values.items():
            if self.context.scope.tell(name, value):
                self.note_change(name, value)

    def missing(self) -> str:
        """Return what it still waits for; empty if unknown."""
        return ""

    def end(self) -> None:
        """Leave nothing running; called whenever it ends, possibly without having begun."""

    def initialise(self) -> None:
        self._error = ""
        try:
            self.begin()
        except Exception as error:
            self._error = reason_of(error)

    def update(self) -> Status:
        self.feedback_message = ""
        if not self._error:
            try:
                return self.step()
            except Exception as error:
                self._error = reason_of(error)
        self.feedback_message = with_location(self._error, self.spec)
        return FAILURE

    def terminate(self, new_status: Status) -> None:
        try:
            self.end()
        except Exception as error:
            if self._error:
                return  # the first error counts
            self.feedback_message = with_location(reason_of(error), self.spec)


class GoalLeaf(Leaf):
    """A leaf that follows one goal or request, and cancels it when it is stopped."""

    _run: GoalRun | None = None

    def end(self) -> None:
        if self._run is not None and not self._run.state.ended:
            self._run.cancel()
