# SPDX-License-Identifier: Apache-2.0
"""Bare rclpy programs with the work of a host, scene layer and feedback node for a run."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_msgs.msg import Float64, Header, String

from bare import EVENTS, LATCHED, SERVICES, spin
from bt_agents_interfaces.action import RunAgent, Say
from bt_agents_interfaces.msg import Feedback, Scene, SceneValue, TreeStatus

SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Cancelled(Node):
    """Runs until it is cancelled."""

    def __init__(self) -> None:
        super().__init__("bare_host")
        self._ended: Any = None
        ActionServer(
            self,
            RunAgent,
            "~/run",
            execute_callback=self._execute,
            cancel_callback=self._cancel,
            result_timeout=2,
            **SERVICES,
        )

    def _cancel(self, _handle: Any) -> CancelResponse:
        self._ended.set_result(None)
        return CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> RunAgent.Result:
        self._ended = Future(executor=self.executor)
        handle.publish_feedback(RunAgent.Feedback())
        await self._ended
        handle.canceled()
        return RunAgent.Result(outcome=RunAgent.Result.CANCELLED, message="cancelled")


class Waiting(Node):
    """Publishes at once that a message or the result of a goal has arrived."""

    def __init__(self) -> None:
        super().__init__("bare_host")
        self._status = self.create_publisher(TreeStatus, "~/status", EVENTS)
        self.create_subscription(String, "heard", self._hear, SENSOR)
        self.create_subscription(String, "begin", self._begin, EVENTS)
        self._say = ActionClient(self, Say, "say", **SERVICES)

    def _hear(self, _message: String) -> None:
        self._status.publish(TreeStatus(header=Header(stamp=self.get_clock().now().to_msg())))

    def _begin(self, message: String) -> None:
        sent = self._say.send_goal_async(Say.Goal(text=message.data))
        sent.add_done_callback(self._accepted)

    def _accepted(self, future: Any) -> None:
        future.result().get_result_async().add_done_callback(self._ended)

    def _ended(self, _future: Any) -> None:
        self._status.publish(TreeStatus(header=Header(stamp=self.get_clock().now().to_msg())))


class Mood(Node):
    """Turns a message about a face into a scene."""

    def __init__(self) -> None:
        super().__init__("bare_scene_layer")
        self._live = self.create_publisher(Scene, "bt_agents/scene/live", SENSOR)
        self.create_subscription(Float64, "person/valence", self._see, SENSOR)

    def _see(self, message: Float64) -> None:
        values = [
            SceneValue(name=name, value=value)
            for name, value in (("age", 3.0), ("familiarity", 3.0), ("mood", 3 + 2 * message.data))
        ]
        self._live.publish(
            Scene(header=Header(stamp=self.get_clock().now().to_msg()), values=values)
        )


class Learning(Node):
    """Commits a row for each scene, as durably as the ledger, and publishes that."""

    def __init__(self, file: Path) -> None:
        super().__init__("bare_feedback")
        self._database = sqlite3.connect(file, isolation_level=None)
        self._database.execute("PRAGMA journal_mode = WAL")
        self._database.execute("PRAGMA synchronous = FULL")
        self._database.execute("CREATE TABLE revision (number INTEGER PRIMARY KEY, profile TEXT)")
        self._feedback = self.create_publisher(Feedback, "bt_agents/feedback", LATCHED)
        self.create_subscription(Scene, "bt_agents/scene/live", self._see, SENSOR)

    def _see(self, message: Scene) -> None:
        before = [value.value for value in message.values]
        after = [value + 0.2 * (3.0 - value) for value in before]
        self._database.execute("BEGIN IMMEDIATE")
        self._database.execute("INSERT INTO revision (profile) VALUES (?)", (repr(after),))
        self._database.execute("COMMIT")
        self._feedback.publish(Feedback(agent="a", before=before, after=after))


PROGRAMS: dict[str, Callable[..., Node]] = {
    "cancelled": Cancelled,
    "waiting": Waiting,
    "mood": Mood,
    "learning": lambda file: Learning(Path(file)),
}
"""Programs of this module by the first word of the command line."""


if __name__ == "__main__":
    rclpy.init()
    spin(PROGRAMS[sys.argv[1]](*sys.argv[2:]))
