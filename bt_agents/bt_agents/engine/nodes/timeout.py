# SPDX-License-Identifier: Apache-2.0
"""Timeout: stops the child when it runs too long."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.decorator import Decorator
from bt_agents.engine.leaf import Leaf
from bt_agents.engine.light_behaviour import RUNNING


class Timeout(Decorator):
    """FAILURE when the child still runs after a time, on the trees' clock; it may be tuned.

    A child that ends in the tick in which its time is up ends as it does.
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
        """Return what the child still waits for, where its tip says so."""
        tip = self.decorated.tip()
        missing = tip.missing() if isinstance(tip, Leaf) else ""
        return f": {missing}" if missing else ""


BEHAVIOURS = {"timeout": Timeout}
