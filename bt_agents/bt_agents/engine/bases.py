# SPDX-License-Identifier: Apache-2.0
"""Base classes of all node types: leaves, composites and decorators, each built from a spec."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from py_trees import composites, decorators
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.environment import GoalRun
from bt_agents.engine.light_behaviour import FAILURE, INVALID, RUNNING, LightBehaviour
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.scope import NodeFields, Scope
from bt_agents.engine.ticker import CallTicked, Ticker
from bt_agents_core.field_types import Plain
from bt_agents_language.expression.expressions import MissingValue
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
