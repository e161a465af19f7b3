# SPDX-License-Identifier: Apache-2.0
"""Once: skips the child after it has ended in this run."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.light_behaviour import RUNNING
from bt_agents.engine.skips import Skip


class Once(Skip):
    """Skips the child after its first SUCCESS or FAILURE; a stop does not count."""

    _done = False

    def skip_reason(self) -> str:
        return "done once already" if self._done else ""

    def decide(self) -> Status:
        self._done = self.decorated.status is not RUNNING
        return self.decorated.status


BEHAVIOURS = {"once": Once}
