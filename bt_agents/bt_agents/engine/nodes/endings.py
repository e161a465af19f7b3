# SPDX-License-Identifier: Apache-2.0
"""Succeed, fail and invert: another end for a child."""

from __future__ import annotations

from typing import ClassVar

from py_trees.common import Status

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.decorator import Decorator
from bt_agents.engine.light_behaviour import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.node_errors import with_location
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticker import Ticker
from bt_agents_language.model.specs import NodeSpec


class Succeed(Decorator):
    """SUCCESS for FAILURE."""

    def tick_children(self, ticker: Ticker) -> Status:
        status = ticker.ticks[self.decorated]()
        return RUNNING if status is RUNNING else SUCCESS


class Fail(Decorator):
    """FAILURE for SUCCESS."""

    why: ClassVar[str] = "succeeded, and counts as failed"

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        super().__init__(spec, context, scope, build)
        self._failure = with_location(self.why, spec)

    def tick_children(self, ticker: Ticker) -> Status:
        status = ticker.ticks[self.decorated]()
        self.feedback_message = self._failure if status is SUCCESS else ""
        return RUNNING if status is RUNNING else FAILURE


class Invert(Fail):
    """SUCCESS for FAILURE and FAILURE for SUCCESS."""

    why = "succeeded, and is inverted"

    def tick_children(self, ticker: Ticker) -> Status:
        status = ticker.ticks[self.decorated]()
        self.feedback_message = self._failure if status is SUCCESS else ""
        if status is RUNNING:
            return RUNNING
        return FAILURE if status is SUCCESS else SUCCESS


BEHAVIOURS = {"succeed": Succeed, "fail": Fail, "invert": Invert}
