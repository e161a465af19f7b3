# SPDX-License-Identifier: Apache-2.0
"""Timeout: stops the child when it runs too long."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Decorator, Leaf
from bt_agents.engine.light_behaviour import RUNNING


class Timeout(Decorator):
    """FAILURE if the child still runs after a time on the trees' clock; the time can be tuned.

    A child that ends in the very tick in which its time is up keeps its result.
    """

    _start = 0.0

    def initialise(self) -> None:
        self._start = self.context.clock()

    def decide(self) -> Status:
        if self.decorated.status is not RUNNING:
            return self.decorated.status
        limit = self.fields.seconds("limit")
        if self.context.is_due(self.spec.path, self._start + limit):
            return self.fail(f"not done within {limit:g} s{self._missing()}")
        return RUNNING

    def _missing(self) -> str:
        """Return what the child still waits for, if its tip reports that."""
        tip = self.decorated.tip()
        missing = tip.missing() if isinstance(tip, Leaf) else ""
        return f": {missing}" if missing else ""


BEHAVIOURS = {"timeout": Timeout}
