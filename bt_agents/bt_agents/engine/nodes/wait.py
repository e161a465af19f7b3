# SPDX-License-Identifier: Apache-2.0
"""Wait: SUCCESS after a time."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Leaf
from bt_agents.engine.light_behaviour import RUNNING, SUCCESS
from bt_agents_language.model.specs import Literal


class Wait(Leaf):
    """SUCCESS after a time on the trees' clock; the time can be tuned during the wait."""

    _start = 0.0

    def begin(self) -> None:
        self._start = self.context.clock()

    def step(self) -> Status:
        duration = self.fields.seconds("duration")
        if self.context.is_due(self.spec.path, self._start + duration):
            return SUCCESS
        if not isinstance(self.spec.fields["duration"], Literal):
            self.feedback_message = f"{duration:g} s"
        return RUNNING


BEHAVIOURS = {"wait": Wait}
