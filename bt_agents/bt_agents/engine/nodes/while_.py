# SPDX-License-Identifier: Apache-2.0
"""While: stops the child as soon as a condition is no longer true."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Decorator
from bt_agents.engine.light_behaviour import RUNNING


class While(Decorator):
    """FAILURE as soon as the condition is not true; evaluates it at each tick before the child."""

    def short_circuit(self) -> Status | None:
        verb = "not so any more" if self.status is RUNNING else "not so"
        reason = self.why_not("condition", verb=verb)
        return self.fail(reason) if reason else None


BEHAVIOURS = {"while": While}
