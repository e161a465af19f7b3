# SPDX-License-Identifier: Apache-2.0
"""Retry: restarts the child after a FAILURE."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.light_behaviour import FAILURE
from bt_agents.engine.loops import Loop


class Retry(Loop):
    """SUCCESS at the first SUCCESS of the child, FAILURE after a number of attempts."""

    limit_field = "attempts"

    def ended(self, status: Status) -> Status:
        if status is not FAILURE:
            return status
        attempts = self.fields.count("attempts")
        if self.exhausted(attempts):
            times = "once" if self._round == 1 else f"{self._round} times"
            return self.fail(f"failed {times}")
        return self.again("attempt", attempts)


BEHAVIOURS = {"retry": Retry}
