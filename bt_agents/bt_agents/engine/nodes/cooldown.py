# SPDX-License-Identifier: Apache-2.0
"""Cooldown: skips the child for some time after it has ended."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.light_behaviour import RUNNING
from bt_agents.engine.skips import Skip


class Cooldown(Skip):
    """Skips the child for some time after its end, on the trees' clock; the time can be tuned."""

    _ended_at: float | None = None

    @property
    def over_at(self) -> float | None:
        """When the child may start again, on the trees' clock [s]; None while unknown.

        It is unknown for a duration that is not constant, unless the child was just skipped.
        """
        duration = self.fields.constant("duration")
        if self._ended_at is None or not isinstance(duration, int | float):
            return None
        return self._ended_at + duration

    def skip_reason(self) -> str:
        if self._ended_at is None:
            return ""
        seconds = self.fields.seconds("duration")
        if self.context.is_due(self.spec.path, self._ended_at + seconds):
            return ""
        return f"done less than {seconds:g} s ago"

    def decide(self) -> Status:
        if self.decorated.status is not RUNNING:
            self._ended_at = self.context.clock()
        return self.decorated.status


BEHAVIOURS = {"cooldown": Cooldown}
