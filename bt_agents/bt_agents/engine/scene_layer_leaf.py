# SPDX-License-Identifier: Apache-2.0
"""Leaf that sends a request to the scene layer and waits a bounded time for the answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from py_trees.common import Status

from bt_agents.engine.bases import GoalLeaf
from bt_agents.engine.environment import GoalState, SkillGoal
from bt_agents_core.field_types import Plain
from bt_agents_language.model.specs import Binding, Timeouts

_TIMEOUTS = Timeouts(server_s=1.0, accept_s=1.0, result_s=1.0)


class SceneLayerLeaf(GoalLeaf):
    """FAILURE with the reason if the scene layer refuses, is missing or does not answer."""

    binding: ClassVar[Binding]

    def request(self, fields: Mapping[str, Plain]) -> None:
        """Send the request."""
        goal = SkillGoal(
            kind=self.binding.kind,
            name=self.binding.name,
            type=self.binding.type,
            fields=fields,
            sender=self.spec.path,
            timeouts=_TIMEOUTS,
        )
        self._run = self.context.send(self.spec.path, goal)

    def answered(self) -> Status:
        """Return RUNNING until the scene layer has answered, then the resulting status."""
        assert self._run is not None
        state = self._run.state
        if not state.ended:
            return Status.RUNNING
        result = self._run.result
        if state is GoalState.SUCCEEDED and result.get("accepted") is True:
            return Status.SUCCESS
        if state is GoalState.SUCCEEDED:
            reason = result.get("message") or result.get("code") or "without a reason"
            self.feedback_message = f"the scene layer refuses it: {reason}"
        else:
            reason = self._run.message
            self.feedback_message = f"the scene layer is {state.value}" + (
                f": {reason}" if reason else ""
            )
        return Status.FAILURE
