# SPDX-License-Identifier: Apache-2.0
"""Client of the service ``select``, which ranks bids for the strategy ``external``."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from bt_agents_interfaces.srv import SelectAgent
from bt_agents_ros import qos
from bt_agents_ros.calls import Calls
from marketplace_node.effects import Effect, RequestRanking
from marketplace_node.market import Market
from marketplace_node.node.messages import selection_from_msg, selection_to_msg
from marketplace_node.round.decision import External


class ExternalRankingClient:
    """Client that requests each ranking once; the market owns the deadline.

    Args:
        node: The marketplace node.
        market: Who is told.
        execute: Executes the effects that the market answers with.
    """

    def __init__(
        self, node: Node, market: Market, execute: Callable[[list[Effect]], None]
    ) -> None:
        self._market = market
        self._execute = execute
        self._calls = Calls(node)
        # Made before it is needed, so that the server is found by then.
        self._client = node.create_client(SelectAgent, "select", qos_profile=qos.SERVICE)

    @property
    def there(self) -> bool:
        """True when the service is available."""
        return bool(self._client.service_is_ready())

    def ask(self, effect: RequestRanking) -> None:
        """Ask for the ranking of a round."""

        def answered(answer: Any) -> None:
            self._report(effect, selection_from_msg(answer, effect.agents))

        if not self.there:
            self._report(effect, External(failure=f"no selector serves '{self._client.srv_name}'"))
            return
        self._calls.call(
            self._client,
            selection_to_msg(effect, self._market.epoch),
            deadline_s=effect.limit_s,
            on_answer=answered,
            on_failure=lambda reason: self._report(effect, External(failure=reason)),
        )

    def _report(self, effect: RequestRanking, external: External) -> None:
        self._execute(self._market.ranked(effect.round, external, time.monotonic()))
