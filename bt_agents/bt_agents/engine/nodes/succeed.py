# SPDX-License-Identifier: Apache-2.0
"""Succeed: SUCCESS however the child ends."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.bases import Decorator
from bt_agents.engine.light_behaviour import RUNNING, SUCCESS
from bt_agents.engine.ticker import Ticker


class Succeed(Decorator):
    """SUCCESS for FAILURE."""

    def tick_children(self, ticker: Ticker) -> Status:
        status = ticker.ticks[self.decorated]()
        return RUNNING if status is RUNNING else SUCCESS


BEHAVIOURS = {"succeed": Succeed}
