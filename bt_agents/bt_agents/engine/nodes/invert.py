# SPDX-License-Identifier: Apache-2.0
"""Invert: exchanges SUCCESS and FAILURE."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.decorator import Decorator
from bt_agents.engine.light_behaviour import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.node_errors import with_location
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticker import Ticker
from bt_agents_language.model.specs import NodeSpec


class Invert(Decorator):
    """SUCCESS for FAILURE and FAILURE for SUCCESS."""

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        super().__init__(spec, context, scope, build)
        self._failure = with_location("succeeded, and is inverted", spec)

    def tick_children(self, ticker: Ticker) -> Status:
        status = ticker.ticks[self.decorated]()
        self.feedback_message = self._failure if status is SUCCESS else ""
        if status is RUNNING:
            return RUNNING
        return FAILURE if status is SUCCESS else SUCCESS


BEHAVIOURS = {"invert": Invert}
