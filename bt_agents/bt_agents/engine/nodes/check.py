# SPDX-License-Identifier: Apache-2.0
"""Check: whether a condition is true now."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Leaf
from bt_agents.engine.light_behaviour import FAILURE, SUCCESS


class Check(Leaf):
    """SUCCESS if the condition is true, FAILURE if it is false or unknown."""

    def step(self) -> Status:
        if self.fields.is_true("condition"):
            return SUCCESS
        self.feedback_message = self.fields.explain_false("condition")
        return FAILURE


BEHAVIOURS = {"check": Check}
