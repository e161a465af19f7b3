# SPDX-License-Identifier: Apache-2.0
"""While: stops the child as soon as a condition is not true."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.decorator import Decorator
from bt_agents.engine.light_behaviour import RUNNING
from bt_agents.engine.node_errors import reason_of


class While(Decorator):
    """FAILURE as soon as the condition is not true; evaluated at each tick, before the child."""

    def short_circuit(self) -> Status | None:
        reason = self._why_not()
        return self.fail(reason) if reason else None

    def _why_not(self) -> str:
        try:
            if self.fields.is_true("condition"):
                return ""
        except Exception as error:
            return reason_of(error)
        verb = "not so any more" if self.status is RUNNING else "not so"
        return self.fields.explain_false("condition", verb=verb)


BEHAVIOURS = {"while": While}
