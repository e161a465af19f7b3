# SPDX-License-Identifier: Apache-2.0
"""Open goals of the hosts: receives their lists, and cancels goals for the market."""

from __future__ import annotations

import time

from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import OpenGoal
from bt_agents_core.ros_names import LONGEST_NAME
from bt_agents_interfaces.msg import OpenGoals
from bt_agents_ros import qos
from bt_agents_ros.goal_cancellation import GoalCanceller, open_goals_from_msg
from marketplace_node.effects import Execute, Note
from marketplace_node.formatting import shown
from marketplace_node.hosts.host_effects import CancelOpenGoals
from marketplace_node.market import Market


class OpenGoalsSubscription:
    """Subscription to ``bt_agents/open_goals``, with the client that cancels."""

    def __init__(self, node: Node, market: Market, execute: Execute) -> None:
        self._market = market
        self._execute = execute
        self._canceller = GoalCanceller(node)
        node.create_subscription(OpenGoals, "bt_agents/open_goals", self._take, qos.FACTS)

    def cancel(self, effect: CancelOpenGoals) -> None:
        """Cancel goals, and report the outcome to the market."""

        def report(unconfirmed: tuple[OpenGoal, ...]) -> None:
            now = time.monotonic()
            self._execute(
                self._market.goals_cancelled(effect.host, effect.instance, unconfirmed, now)
            )

        self._canceller.cancel(effect.goals, within_s=effect.within_s, on_end=report)

    def _take(self, message: OpenGoals) -> None:
        try:
            goals = open_goals_from_msg(message)
        except Refused as refused:
            host = message.host[:LONGEST_NAME]
            self._execute([Note(message=shown(f"open goals of {host}: {refused}"))])
            return
        self._execute(
            self._market.open_goals(message.host, message.host_instance, goals, time.monotonic())
        )
