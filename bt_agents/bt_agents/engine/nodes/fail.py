# SPDX-License-Identifier: Apache-2.0
"""Fail: FAILURE however the child ends."""

from __future__ import annotations

from functools import cached_property

from py_trees.common import Status

from bt_agents.engine.bases import Decorator
from bt_agents.engine.light_behaviour import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.node_errors import with_location
from bt_agents.engine.ticker import Ticker


class Fail(Decorator):
    """FAILURE for SUCCESS."""

    @cached_property
    def _failure(self) -> str:
        return with_location("succeeded, and counts as failed", self.spec)

    def tick_children(self, ticker: Ticker) -> Status:
        status = ticker.ticks[self.decorated]()
        self.feedback_message = self._failure if status is SUCCESS else ""
        return RUNNING if status is RUNNING else FAILURE


BEHAVIOURS = {"fail": Fail}
