# SPDX-License-Identifier: Apache-2.0
"""Give_feedback: feedback on the running agent, as if a person had pressed a button."""

from __future__ import annotations

from collections.abc import Mapping

from py_trees.common import Status

from bt_agents.engine.bases import GoalLeaf
from bt_agents.engine.environment import GoalState
from bt_agents.engine.scope import scene_value
from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.refusal_codes import RefusalCode

_DIRECT = "direct feedback"


class GiveFeedback(GoalLeaf):
    """SUCCESS if the feedback was accepted, FAILURE with the reason if it was refused."""

    has_side_effects = True
    _kind = FeedbackKind.POSITIVE

    def begin(self) -> None:
        self._run = None
        self._kind = FeedbackKind[str(self.fields.value("kind")).upper()]
        values = self._values()
        reason = str(self.fields.value("reason")) if "reason" in self.fields else ""
        self._run = self.context.give_feedback(self.spec.path, self._kind, values, reason)

    def step(self) -> Status:
        assert self._run is not None
        state, title = self._run.state, f"{self._kind.name.lower()} feedback"
        if not state.ended:
            self.feedback_message = title
            return Status.RUNNING
        if state is GoalState.SUCCEEDED:
            self.feedback_message = f"{title} {self._run.message or 'given'}"
            return Status.SUCCESS
        reason = f": {self._run.message}" if self._run.message else ""
        self.feedback_message = f"{title} {state.value}{reason}"
        return Status.FAILURE

    def _values(self) -> Mapping[str, float]:
        if self._kind is not FeedbackKind.DIRECT:
            return {}
        given = self.fields.value("values") if "values" in self.fields else None
        if not isinstance(given, Mapping) or not given:
            raise Refused(
                RefusalCode.EMPTY,
                f"{_DIRECT} has no values, expected at least one scene parameter with the "
                "value that the profile moves to; write values: {age: 4}",
            )
        space = self.context.scope.space.profiles
        return {name: scene_value(space, name, value, _DIRECT) for name, value in given.items()}


BEHAVIOURS = {"give_feedback": GiveFeedback}
