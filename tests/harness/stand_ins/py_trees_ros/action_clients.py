# SPDX-License-Identifier: Apache-2.0
"""A behaviour that creates an action client in ``setup`` and sends a goal at each start."""

from __future__ import annotations

import uuid
from typing import Any

from action_msgs.msg import GoalStatus
from py_trees.behaviour import Behaviour
from py_trees.common import Access, Status
from rclpy.action import ActionClient


class FromConstant(Behaviour):
    """Sends the same goal each time; ``setup`` waits for the server for ever."""

    def __init__(self, name: str, action_type: Any, action_name: str, action_goal: Any) -> None:
        super().__init__(name)
        self.action = (action_type, action_name)
        key = f"/goal_{uuid.uuid4()}"
        self.blackboard = self.attach_blackboard_client(name=name)
        self.blackboard.register_key(key="goal", access=Access.READ, remap_to=key)
        self.blackboard.register_key(key=key, access=Access.WRITE)
        self.blackboard.set(name=key, value=action_goal)
        self.action_client: Any = None
        self.handle: Any = None
        self.result: Any = None

    def setup(self, **kwargs: Any) -> None:
        kind, name = self.action
        self.action_client = ActionClient(node=kwargs["node"], action_type=kind, action_name=name)
        while not self.action_client.wait_for_server(timeout_sec=3.0):
            pass

    def initialise(self) -> None:
        self.handle = self.result = None
        sent = self.action_client.send_goal_async(
            self.blackboard.goal, feedback_callback=lambda _: None
        )
        sent.add_done_callback(self._accepted)

    def update(self) -> Status:
        if self.handle is not None and not self.handle.accepted:
            return Status.FAILURE
        if self.result is None:
            return Status.RUNNING
        done = self.result.status == GoalStatus.STATUS_SUCCEEDED
        return Status.SUCCESS if done else Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        stopped = self.status is Status.RUNNING and new_status is Status.INVALID
        if stopped and self.handle is not None:
            self.handle.cancel_goal_async()

    def shutdown(self) -> None:
        self.action_client.destroy()

    def _accepted(self, future: Any) -> None:
        self.handle = future.result()
        if self.handle.accepted:
            self.handle.get_result_async().add_done_callback(self._ended)

    def _ended(self, future: Any) -> None:
        self.result = future.result()
