# SPDX-License-Identifier: Apache-2.0
"""Requests to the market to cancel runs, repeated until it answers."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from bt_agents_core.stop_cause import StoppedBy
from bt_agents_interfaces.srv import CancelRun
from bt_agents_ros import qos
from bt_agents_ros.calls import Calls
from bt_agents_ros.messages import scene_to_msg
from feedback_node.announced_runs import AnnouncedRun
from feedback_node.learning.feedback_controller import RuleStop

_LIMIT_S = 1.0


class CancelRequests:
    """Sends the requests; repeats an unanswered one while its run continues."""

    def __init__(self, node: Node, calls: Calls, goes_on: Callable[[AnnouncedRun], bool]) -> None:
        self._node = node
        self._calls = calls
        self._goes_on = goes_on
        self._unanswered: list[RuleStop] = []
        self._client = node.create_client(CancelRun, "marketplace/cancel", qos_profile=qos.SERVICE)

    def retry(self) -> None:
        """Resend unanswered requests."""
        stops, self._unanswered = self._unanswered, []
        for stop in stops:
            if self._goes_on(stop.run):
                self.request(stop)

    def request(self, stop: RuleStop) -> None:
        """Request the stop of a run, and another round for its current scene."""
        what = f"{stop.run.agent} in round {stop.run.round} was to be stopped ({stop.reason})"

        def unanswered(problem: str) -> None:
            self._unanswered.append(stop)
            self._node.get_logger().warning(
                f"{what}: {problem}; asked again until its run ends", throttle_duration_sec=10.0
            )

        def answered(response: CancelRun.Response) -> None:
            if not response.accepted:
                self._node.get_logger().error(f"{what}: {response.message}")

        self._calls.call(
            self._client,
            CancelRun.Request(
                epoch=stop.run.epoch,
                round=stop.run.round,
                reason=stop.reason,
                by=StoppedBy.MOOD_RULE,
                again=True,
                scene=scene_to_msg(stop.live),
            ),
            deadline_s=_LIMIT_S,
            on_answer=answered,
            on_failure=unanswered,
        )
