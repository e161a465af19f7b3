# SPDX-License-Identifier: Apache-2.0
"""Cancels the goals that an earlier start of this host left open, before this one takes part."""

from __future__ import annotations

from rclpy.node import Node

from bt_agents.host.environment.open_goals_file import OpenGoalsFile
from bt_agents_core.open_goals import TAKEOVER_S, OpenGoal, name_goals
from bt_agents_ros.goal_cancellation import GoalCanceller


class EarlierGoals:
    """Cancellation of the goals in the file of open goals.

    The file keeps them until it is over, so a host killed meanwhile retries at its next start.

    Attributes:
        ended: True once all have ended or :data:`bt_agents_core.open_goals.TAKEOVER_S` has passed.
    """

    def __init__(self, node: Node, file: OpenGoalsFile) -> None:
        self._node = node
        self._file = file
        goals = file.read()
        self.ended = not goals
        if goals:
            node.get_logger().warning(f"an earlier start has left open: {name_goals(goals)}")
            GoalCanceller(node).cancel(goals, within_s=TAKEOVER_S, on_end=self._end)

    def _end(self, unconfirmed: tuple[OpenGoal, ...]) -> None:
        self.ended = True
        self._file.write(())
        if unconfirmed:
            self._node.get_logger().warning(
                "these may go on, as their servers have not confirmed their end: "
                f"{name_goals(unconfirmed)}"
            )
