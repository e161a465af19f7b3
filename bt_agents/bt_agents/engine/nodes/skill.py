# SPDX-License-Identifier: Apache-2.0
"""Skills, actions, services and topics: one goal, request or message to the robot."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property

from py_trees.common import Status

from bt_agents.engine.bases import GoalLeaf
from bt_agents.engine.environment import GoalState, SkillGoal
from bt_agents.engine.scope import (
    BindingNames,
    MessageNames,
    evaluate,
    explain_false,
    field_of,
    format_value,
)
from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind, Plain
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize, join_first, quote
from bt_agents_language.expression.expressions import Expression, MissingValue
from bt_agents_language.model.specs import (
    Binding,
    Computed,
    Literal,
    Place,
    Reference,
    Text,
    Value,
    Variants,
)

_WHY = {
    GoalState.REJECTED: "its server did not take the goal and says nothing about why",
    GoalState.ABORTED: "its server gave up and says nothing about why",
    GoalState.CANCELLED: "somebody else has stopped it",
}
"""Reasons for failures if the server gives none."""

_NO_PLACES = "no skills file has the key 'places'"
"""Reason for an unknown place if no places are declared at all."""

_LONGEST_REASON = 300
"""Most characters of a server's message in a reason."""


class SkillLeaf(GoalLeaf):
    """Uses an action, service or topic, directly or through a skill.

    Its failure message says what happened: the server is unreachable, has rejected, aborted or
    cancelled the goal, or has timed out.
    """

    has_side_effects = True
    _last_feedback: Mapping[str, Plain] | None = None
    _main_text = ""

    @cached_property
    def _last_variants(self) -> dict[Variants, int]:
        return {}

    def begin(self) -> None:
        self._run = self._last_feedback = None
        skill = self.spec.skill
        assert skill is not None
        binding = self._binding()
        inputs = {one.name: self._input(one.name) for one in skill.inputs}
        self._main_text = self._format_main_input(inputs)
        names = BindingNames(inputs=inputs, around=self.scope, place=_place(binding, inputs))
        goal = SkillGoal(
            kind=binding.kind,
            name=binding.name,
            type=binding.type,
            fields={key: evaluate(item, names) for key, item in binding.fields.items.items()},
            sender=self.spec.path,
            feedback=bool(self.spec.feedback),
            timeouts=binding.timeouts,
            heartbeat=binding.heartbeat,
        )
        if binding.kind is BindingKind.TOPIC:
            self.context.environment.publish(goal)
        else:
            self._run = self.context.send(self.spec.path, goal)

    def step(self) -> Status:
        if self._run is None:
            return Status.SUCCESS
        state = self._run.state
        self._store_feedback(self._run.feedback)
        if not state.ended:
            said, remark = self._main_text, self._run.message
            self.feedback_message = f"{said} ({remark})" if said and remark else said or remark
            return Status.RUNNING
        if state is GoalState.SUCCEEDED:
            return self._succeeded(self._run.result)
        result = self._run.result
        reason = self._run.message or self._error_in(result) or _result_message(result)
        reason = reason or _WHY.get(state, "")
        self.feedback_message = f"{self._binding().name} {state.value}" + (
            f": {ellipsize(reason, _LONGEST_REASON)}" if reason else ""
        )
        return Status.FAILURE

    def _input(self, name: str) -> Plain:
        value = self.spec.fields[name]
        assert not isinstance(value, Expression)
        return evaluate(self._settled(value), self.scope)

    def _settled(self, value: Value) -> Value:
        """Return a value with one text instead of its variants, never the same twice in a row."""
        match value:
            case Variants():
                return self._picked(value)
            case Text(parts=parts) if any(isinstance(part, Variants) for part in parts):
                return Text(parts=tuple(one for part in parts for one in self._settled_part(part)))
        return value

    def _settled_part(
        self, part: str | Reference | Computed | Variants
    ) -> tuple[str | Reference | Computed | Variants, ...]:
        if not isinstance(part, Variants):
            return (part,)
        picked = self._picked(part)
        if isinstance(picked, Text):
            return picked.parts
        return (picked if isinstance(picked, Reference) else str(picked.value),)

    def _picked(self, variants: Variants) -> Literal | Reference | Text:
        last = self._last_variants.get(variants)
        number = self.context.pick(self.spec.path, len(variants.texts), last)
        self._last_variants[variants] = number
        return variants.texts[number]

    def _binding(self) -> Binding:
        skill = self.spec.skill
        assert skill is not None
        if skill.binding is None:
            reason = skill.unoffered or "no robot here offers it"
            raise Refused(RefusalCode.NOT_OFFERED, f"'{skill.name}' cannot be done: {reason}")
        return skill.binding

    def _succeeded(self, result: Mapping[str, Plain]) -> Status:
        binding = self._binding()
        error = self._error_in(result)
        if error:
            self.feedback_message = f"{binding.name} failed: {error}"
            return Status.FAILURE
        if binding.succeed_when is not None:
            names = MessageNames(prefix="result", message=result, around=self.scope)
            if not binding.succeed_when.is_true(names.lookup):
                reason = explain_false(binding.succeed_when, names)
                self.feedback_message = _result_message(result) or (
                    f"{binding.name} answered, but {reason}"
                )
                return Status.FAILURE
        found = {
            name: field_of(result, path, f"result.{path}")
            for name, path in self.spec.outputs.items()
        }
        for name, value in found.items():
            self.write(name, value)
        return Status.SUCCESS

    def _error_in(self, result: Mapping[str, Plain]) -> str:
        """Return code and reason of a result that reports a failure; empty for others."""
        declared = self._binding().error_code
        if declared is None or not result:
            return ""
        code = field_of(result, declared.field, f"result.{declared.field}")
        if code in declared.success:
            return ""
        message: Plain = None
        if declared.message:
            # Even without a reason, the code means a failure.
            with suppress(MissingValue, Refused):
                message = field_of(result, declared.message, f"result.{declared.message}")
        return ellipsize(f"code {code}: {message}" if message else f"code {code}", _LONGEST_REASON)

    def _store_feedback(self, feedback: Mapping[str, Plain] | None) -> None:
        """Write the values of the latest feedback of the action to their names."""
        if feedback is None or feedback is self._last_feedback:
            return
        self._last_feedback = feedback
        for name, path in self.spec.feedback.items():
            # Feedback without the field does not fail the goal.
            with suppress(MissingValue, Refused):
                self.write(name, field_of(feedback, path, f"feedback.{path}"))

    def _format_main_input(self, inputs: Mapping[str, Plain]) -> str:
        """Return the text of the main input, for a node whose name contains references."""
        skill = self.spec.skill
        assert skill is not None
        if skill.main is None or isinstance(self.spec.fields[skill.main], Literal):
            return ""
        [main] = (one for one in skill.inputs if one.name == skill.main)
        return format_value(inputs[skill.main], main.type)


def _place(binding: Binding, inputs: Mapping[str, Plain]) -> Place | None:
    """Return the place that an input names; None without one."""
    if not binding.place:
        return None
    name = str(inputs[binding.place])
    place = binding.places.get(name)
    if place is None:
        known = f"there are {join_first(binding.places)}" if binding.places else _NO_PLACES
        raise Refused(RefusalCode.UNKNOWN_PLACE, f"there is no place {quote(name)}; {known}")
    return place


def _result_message(result: Mapping[str, Plain]) -> str:
    message = result.get("message", "")
    return ellipsize(message, _LONGEST_REASON) if isinstance(message, str) else ""


BEHAVIOURS = {"action": SkillLeaf, "service": SkillLeaf, "publish": SkillLeaf}
