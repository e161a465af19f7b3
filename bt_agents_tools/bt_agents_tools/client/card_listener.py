# SPDX-License-Identifier: Apache-2.0
"""Hears from the cards of hosts what is new with their agents, and asks what has changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.client import Client
from rclpy.node import Node

from bt_agents.host.reload.host_card_diff import CardDiff, CardDifference
from bt_agents_interfaces.srv import ListVersions
from bt_agents_ros import qos
from bt_agents_ros.calls import Calls

_LIMIT_S = 1.0


class CardListener:
    """Tells in words what the cards say.

    Args:
        node: Whose graph it listens in.
        tell: Takes words, and whether somebody has to mend something.
    """

    def __init__(self, node: Node, tell: Callable[[str, bool], None]) -> None:
        self._node = node
        self._tell = tell
        self._news = CardDiff()
        self._calls = Calls(node)
        self._clients: dict[str, Client] = {}

    def take(self, card: Any) -> None:
        """Take a card."""
        for news in self._news.take(card):
            if news.agent:
                self._ask(card.host, news)
            else:
                self._tell(news.text, news.is_error)

    def _ask(self, host: str, news: CardDifference) -> None:
        if host not in self._clients:
            self._clients[host] = self._node.create_client(
                ListVersions, f"{host}/versions", qos_profile=qos.SERVICE
            )

        def answered(answer: Any) -> None:
            change = next((one.change for one in answer.versions if one.current), "")
            self._tell(news.text + (f" ({change})" if change else ""), news.is_error)

        self._calls.call(
            self._clients[host],
            ListVersions.Request(agent=news.agent),
            deadline_s=_LIMIT_S,
            on_answer=answered,
            on_failure=lambda _reason: self._tell(news.text, news.is_error),
        )
