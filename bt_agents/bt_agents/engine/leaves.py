# SPDX-License-Identifier: Apache-2.0
"""The leaves of a tree: what it checks, remembers, waits for and asks of the robot."""

from __future__ import annotations

from collections.abc import Mapping

import py_trees
from py_trees.common import Status

from bt_agents.engine.context import RunContext, place
from bt_agents.engine.scope import (
    InputScope,
    MessageScope,
    Scope,
    evaluate,
    field_of,
    holds,
    spoken,
)
from bt_agents.engine.world import Goal, GoalRun, GoalState, Inbox
from bt_agents.errors import Refused
from bt_agents.language.expressions import EvaluationError, Expression, MissingValue
from bt_agents.language.specs import (
    BindingKind,
    Literal,
    MapValue,
    NodeSpec,
    Plain,
)


class Leaf(py_trees.behaviour.Behaviour):
    """A leaf made from a spec; whatever it raises is a FAILURE that says where and why.

    Subclasses override :meth:`begin`, :meth:`step` and :meth:`end`, each of which may raise.
    """

    def __init__(self, spec: NodeSpec, context: RunContext, scope: Scope) -> None:
        super().__init__(spec.name)
        self.spec = spec
        self.context = context
        self.scope = scope
        self._fault = ""

    def begin(self) -> None:
        """Start: called at the first tick."""

    def step(self) -> Status:
        """Go on: called at every tick, the first included."""
        raise NotImplementedError

    def end(self) -> None:
        """Stop whatever is under way: called when it is interrupted, maybe more than once."""

    def condition(self, name: str) -> Expression:
        """Return the condition of a field."""
        value = self.spec.fields[name]
        assert isinstance(value, Expression)
        return value

    def value(self, name: str) -> Plain:
        """Return what a field means now."""
        value = self.spec.fields[name]
        assert not isinstance(value, Expression)
        return evaluate(value, self.scope)

    def seconds(self, name: str) -> float:
        """Return what a duration field means now [s].

        Raises:
            Refused: It is not a number that can be waited for.
        """
        return duration(self.value(name), name)

    def initialise(self) -> None:
        """Begin, keeping any error for :meth:`update`."""
        self._fault = ""
        try:
            self.begin()
        except Exception as error:
            self._fault = why(error)

    def update(self) -> Status:
        """Step; an error is a FAILURE."""
        self.feedback_message = ""
        if not self._fault:
            try:
                return self.step()
            except Exception as error:
                self._fault = why(error)
        self.feedback_message = f"{self._fault} ({place(self.spec.path, self.spec.position)})"
        return Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        """End when interrupted, and after an error."""
        if new_status is Status.INVALID or self._fault:
            try:
                self.end()
            except Exception as error:
                self.feedback_message = why(error)


def why(error: Exception) -> str:
    """Return an error as a reason in words."""
    match error:
        case MissingValue():
            return f"'{error.name}' has no value"
        case Refused():
            return error.reason
        case EvaluationError():
            return str(error)
        case _:
            return f"{type(error).__name__}: {error}"


def duration(value: Plain, name: str) -> float:
    """Return a duration [s].

    Raises:
        Refused: ``NOT_A_DURATION``; it is no number, or negative.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
        raise Refused("NOT_A_DURATION", f"{name} is {value!r}, expected a time such as '5 s'")
    return float(value)


class Check(Leaf):
    """SUCCESS when the condition is true, FAILURE when it is false or not known."""

    def step(self) -> Status:
        """Look at the condition."""
        condition = self.condition("condition")
        if holds(condition, self.scope):
            return Status.SUCCESS
        self.feedback_message = f"not so: {condition.text}"
        return Status.FAILURE


class Set(Leaf):
    """Writes values to the blackboard of the run."""

    def step(self) -> Status:
        """Write."""
        for name in self.spec.fields:
            self.context.scope.blackboard[name] = self.value(name)
        return Status.SUCCESS


class Wait(Leaf):
    """SUCCESS after a time; the time may be tuned while it passes."""

    def begin(self) -> None:
        """Note the start."""
        self._start = self.context.clock()

    def step(self) -> Status:
        """Look at the clock."""
        whole = self.seconds("duration")
        if self._start + whole <= self.context.clock():
            return Status.SUCCESS
        if not isinstance(self.spec.fields["duration"], Literal):
            self.feedback_message = f"{whole:g} s"
        return Status.RUNNING


class WaitFor(Leaf):
    """SUCCESS when a message arrives, or one for which the condition is true."""

    _inbox: Inbox | None = None

    def begin(self) -> None:
        """Listen."""
        self._inbox = self.context.watch(str(self.value("topic")), str(self.value("type")))

    def step(self) -> Status:
        """Look at what has come."""
        assert self._inbox is not None
        while (message := self._inbox.take()) is not None:
            if "until" not in self.spec.fields or self._fits(message):
                self.end()
                return Status.SUCCESS
        return Status.RUNNING

    def _fits(self, message: Mapping[str, Plain]) -> bool:
        scope = MessageScope(prefix="msg", message=message, around=self.scope)
        return holds(self.condition("until"), scope)

    def end(self) -> None:
        """Stop listening."""
        if self._inbox is not None:
            self._inbox.close()
            self._inbox = None


class SkillLeaf(Leaf):
    """Uses an action, service or topic, directly or through a skill."""

    _run: GoalRun | None = None
    _meant = ""

    def begin(self) -> None:
        """Send."""
        self._run = None
        skill = self.spec.skill
        assert skill is not None
        fields: dict[str, Literal] = {}
        for spec in skill.inputs:
            value = self.spec.fields[spec.name]
            assert not isinstance(value, Expression)
            fields[spec.name] = Literal(value=evaluate(value, self.scope))
        self._meant = _meant(self.spec, fields)
        inputs = InputScope(inputs=fields, caller=self.scope)
        binding = skill.binding
        goal = Goal(
            kind=binding.kind,
            name=binding.name,
            type=binding.type,
            fields=_mapping(binding.fields, inputs),
        )
        if binding.kind is BindingKind.TOPIC:
            self.context.publish(goal)
        else:
            self._run = self.context.send(self.spec.path, goal)

    def step(self) -> Status:
        """Look where it is."""
        if self._run is None:
            return Status.SUCCESS
        state = self._run.state
        if not state.ended:
            self.feedback_message = self._meant
            return Status.RUNNING
        if state is GoalState.SUCCEEDED:
            return self._succeeded(self._run.result)
        assert self.spec.skill is not None
        reason = self._run.message or _result_message(self._run.result)
        self.feedback_message = f"{self.spec.skill.binding.name} {state.value}" + (
            f": {reason}" if reason else ""
        )
        return Status.FAILURE

    def _succeeded(self, result: Mapping[str, Plain]) -> Status:
        skill = self.spec.skill
        assert skill is not None
        binding = skill.binding
        if binding.succeed_when is not None:
            scope = MessageScope(prefix="result", message=result, around=self.scope)
            if not holds(binding.succeed_when, scope):
                self.feedback_message = _result_message(result) or (
                    f"{binding.name} answered, but not so: {binding.succeed_when.text}"
                )
                return Status.FAILURE
        for name, path in binding.outputs.items():
            self.context.scope.blackboard[name] = field_of(result, path, f"result.{path}")
        return Status.SUCCESS

    def end(self) -> None:
        """Cancel what has not ended."""
        if self._run is not None and not self._run.state.ended:
            self._run.cancel()


def _meant(spec: NodeSpec, inputs: Mapping[str, Literal]) -> str:
    """Return what the main input means now, for a node that is named by references."""
    assert spec.skill is not None
    main = spec.skill.main
    if main is None or isinstance(spec.fields[main], Literal):
        return ""
    return spoken(inputs[main].value)


def _mapping(value: MapValue, scope: Scope) -> Mapping[str, Plain]:
    return {key: evaluate(item, scope) for key, item in value.items.items()}


def _result_message(result: Mapping[str, Plain]) -> str:
    message = result.get("message", "")
    return message if isinstance(message, str) else ""
