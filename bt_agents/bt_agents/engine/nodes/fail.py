# SPDX-License-Identifier: Apache-2.0
"""Fail: FAILURE however the child ends."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.decorator import Decorator
from bt_agents.engine.light_behaviour import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.node_errors import with_location
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticker import Ticker
from bt_agents_language.model.specs import NodeSpec


class Fail(Decorator):
    """FAILURE for SUCCESS."""

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        super().__init__(spec, context, scope, build)
        self._failure = with_location("succeeded, and counts as failed", spec)

    def tick_children(self, ticker: Ticker) -> Status:
        status = ticker.ticks[self.decorated]()
        self.feedback_message = self._failure if status is SUCCESS else ""
        return RUNNING if status is RUNNING else FAILURE


BEHAVIOURS = {"fail": Fail}
