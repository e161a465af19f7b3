# SPDX-License-Identifier: Apache-2.0
"""Invert: exchanges SUCCESS and FAILURE."""

from __future__ import annotations

from functools import cached_property

from py_trees.common import Status

from bt_agents.engine.bases import Decorator
from bt_agents.engine.light_behaviour import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.node_errors import with_location
from bt_agents.engine.ticker import Ticker


class Invert(Decorator):
    """SUCCESS for FAILURE and FAILURE for SUCCESS."""

    @cached_property
    def _failure(self) -> str:
        return with_location("succeeded, and is inverted", self.spec)

    def tick_children(self, ticker: Ticker) -> Status:
        status = ticker.ticks[self.decorated]()
        self.feedback_message = self._failure if status is SUCCESS else ""
        if status is RUNNING:
            return RUNNING
        return FAILURE if status is SUCCESS else SUCCESS


BEHAVIOURS = {"invert": Invert}
