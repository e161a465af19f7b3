# SPDX-License-Identifier: Apache-2.0
"""Repeat: restarts the child after a SUCCESS."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.light_behaviour import SUCCESS
from bt_agents.engine.loops import Loop
from bt_agents_language.expression.expressions import MissingValue


class Repeat(Loop):
    """SUCCESS after a number of rounds, or when a condition is true between two of them.

    A FAILURE of the child ends it. A condition with a missing value is not true.
    """

    limit_field = "times"

    def ended(self, status: Status) -> Status:
        if status is not SUCCESS:
            return status
        if self._is_over():
            return SUCCESS
        times = self.fields.count("times")
        if self.exhausted(times):
            return SUCCESS
        return self.again("round", times)

    def begun(self) -> Status | None:
        """Evaluate the condition again, because it may have become true during the pause."""
        return SUCCESS if self._is_over() else None

    def _is_over(self) -> bool:
        try:
            return "until" in self.fields and self.fields.is_true("until")
        except MissingValue:
            return False


BEHAVIOURS = {"repeat": Repeat}
