# SPDX-License-Identifier: Apache-2.0
"""The leaf that gives the running agent feedback, as a person would by a button."""

from __future__ import annotations

from collections.abc import Mapping

from py_trees.common import Status

from bt_agents.engine.environment import GoalRun, GoalState
from bt_agents.engine.fields import finite
from bt_agents.engine.leaves import Leaf
from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_core.scene import check_value
from bt_agents_language.expression.expression_values import described

_DIRECT = "direct feedback"


class GiveFeedback(Leaf):
    """SUCCESS when the feedback was taken, FAILURE with the words in which it was refused."""

    acts = True
    _run: GoalRun | None = None
    _kind = FeedbackKind.POSITIVE

    def begin(self) -> None:
        """Give it."""
        self._run = None
        self._kind = FeedbackKind[str(self.fields.value("kind")).upper()]
        values = self._values()
        reason = str(self.fields.value("reason")) if "reason" in self.fields else ""
        self._run = self.context.give_feedback(self.spec.path, self._kind, values, reason)

    def step(self) -> Status:
        """Look for the answer."""
        assert self._run is not None
        state, words = self._run.state, f"{self._kind.name.lower()} feedback"
        if not state.ended:
            self.feedback_message = words
            return Status.RUNNING
        if state is GoalState.SUCCEEDED:
            self.feedback_message = f"{words} {self._run.message or 'given'}"
            return Status.SUCCESS
        reason = f": {self._run.message}" if self._run.message else ""
        self.feedback_message = f"{words} {state.value}{reason}"
        return Status.FAILURE

    def end(self) -> None:
        """Wait for no answer any more."""
        if self._run is not None and not self._run.state.ended:
            self._run.cancel()

    def _values(self) -> Mapping[str, float]:
        if self._kind is not FeedbackKind.DIRECT:
            return {}
        given = self.fields.value("values") if "values" in self.fields else None
        if not isinstance(given, Mapping) or not given:
            raise Refused(
                "NO_VALUES",
                f"{_DIRECT} has no values, expected at least one scene parameter with the "
                "value that the profile moves to; write values: {age: 4}",
            )
        return {name: self._wanted(name, value) for name, value in given.items()}

    def _wanted(self, name: str, value: Plain) -> float:
        parameter = self.context.scope.space.parameter(name, what=_DIRECT)
        number = finite(value)
        if number is None:
            raise Refused(
                "NOT_A_NUMBER",
                f"{_DIRECT}: {name} is {described(value)}, expected a number between "
                f"{parameter.minimum:g} and {parameter.maximum:g}",
            )
        return check_value(parameter, number, what=_DIRECT)
