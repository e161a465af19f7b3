# SPDX-License-Identifier: Apache-2.0
"""Open goals of this host, published and stored, and the cancellation of those it left open."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from bt_agents.host.environment.open_goals_file import OpenGoalsFile
from bt_agents_core.open_goals import MOST_OPEN_GOALS, TAKEOVER_S, OpenGoal, name_goals
from bt_agents_interfaces.msg import OpenGoal as OpenGoalMsg
from bt_agents_interfaces.msg import OpenGoals
from bt_agents_ros import qos
from bt_agents_ros.goal_cancellation import GoalCanceller

_LOG_PERIOD_S = 30.0


class OpenGoalList:
    """Topic ``bt_agents/open_goals`` of a host, and the file that keeps the list if the host dies.

    A goal is added before it is sent, so a kill of the host in between leaves at worst the id of
    a goal that no server knows.

    Args:
        run: Returns the goal of the current run; None without one.
        file: None keeps the list in memory.
    """

    def __init__(
        self, node: Node, instance: str, run: Callable[[], Any], file: OpenGoalsFile | None = None
    ) -> None:
        self._node = node
        self._run = run
        self._file = file
        self._goals: dict[bytes, tuple[OpenGoal, OpenGoalMsg]] = {}
        self._message = OpenGoals(
            host=str(node.get_fully_qualified_name()),
            host_instance=instance,
            heartbeat=node.resolve_topic_name("~/heartbeat"),
        )
        self._publisher = node.create_publisher(OpenGoals, "bt_agents/open_goals", qos.FACT)
        self._publisher.publish(self._message)

    def add(self, goal: OpenGoal) -> None:
        """Add a goal that is about to be sent."""
        message = OpenGoalMsg(path=goal.path, action=goal.action, goal_id=list(goal.goal_id))
        self._goals[goal.goal_id] = goal, message
        run = self._run()
        if run is not None:
            self._message.epoch, self._message.round = run.epoch, run.round
        self._report()

    def remove(self, goal_id: bytes) -> None:
        """Remove a goal, if listed, when its end is confirmed or it is abandoned."""
        if self._goals.pop(goal_id, None) is not None:
            self._report()

    def _report(self) -> None:
        # The latest ones, because they are the most likely to still run.
        named = list(self._goals.values())[-MOST_OPEN_GOALS:]
        self._message.goals = [message for _, message in named]
        self._publisher.publish(self._message)
        if self._file is None:
            return
        try:
            self._file.write([goal for goal, _ in named])
        except OSError as error:
            self._node.get_logger().error(
                f"open goals are not kept over a restart of this host: {error}",
                throttle_duration_sec=_LOG_PERIOD_S,
            )


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
