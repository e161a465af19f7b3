# SPDX-License-Identifier: Apache-2.0
"""The parts of a round as bare rclpy programs: ``bare_round.py service | market | …``."""

from __future__ import annotations

import sys
from array import array
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.node import Node
from std_msgs.msg import Header

from bare import EVENTS, SERVICES, spin
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Bids, CallForBids, Scene, SceneValue, TreeStatus
from bt_agents_interfaces.srv import Analyze

AGENTS = 3
"""Number of agents of the host."""

NAMES = ("age", "familiarity", "mood")
WANTED = (3.0, 2.0, 3.0)


def scene(scene_id: str) -> Scene:
    """Return a scene of the same size as all scenes of the benchmarks."""
    return Scene(
        scene_id=scene_id,
        person=True,
        values=[
            SceneValue(name=name, value=value, origin=SceneValue.GIVEN, std=0.0, confidence=1.0)
            for name, value in zip(NAMES, WANTED, strict=True)
        ],
    )


def call_for_bids(number: int, of: Scene) -> CallForBids:
    """Return the call for bids of a round."""
    return CallForBids(
        epoch="0123456789ab", round=number, scene=of, parameters=list(NAMES), deadline_s=0.5
    )


def profile(index: int) -> tuple[float, float, float]:
    """Return the bid of an agent by its number; no two of a thousand are equal."""
    return 1 + index % 997 * 4 / 997, 3.0, 3.0


class Service(Node):
    """Publishes a scene for each request, and returns it."""

    def __init__(self) -> None:
        super().__init__("service")
        self._count = 0
        self._scenes = self.create_publisher(Scene, "bt_agents/scene", EVENTS)
        self.create_service(Analyze, "scene_layer/analyze", self._answer, qos_profile=EVENTS)

    def _answer(self, _request: Any, response: Any) -> Any:
        self._count += 1
        response.accepted = True
        response.scene = scene(str(self._count))
        self._scenes.publish(response.scene)
        return response


class Market(Node):
    """Calls one host for bids on each scene and sends it the goal of the nearest agent."""

    def __init__(self) -> None:
        super().__init__("market")
        self._round = 0
        self._scene = Scene()
        self._calls = self.create_publisher(CallForBids, "bt_agents/calls", EVENTS)
        self._runs = ActionClient(
            self, RunAgent, "agents/run", feedback_sub_qos_profile=EVENTS, **SERVICES
        )
        self.create_subscription(Scene, "bt_agents/scene", self._call, EVENTS)
        self.create_subscription(Bids, "bt_agents/bids", self._award, EVENTS)

    def _call(self, message: Scene) -> None:
        self._round += 1
        self._scene = message
        self._calls.publish(call_for_bids(self._round, message))

    def _award(self, bids: Bids) -> None:
        width, values = len(NAMES), bids.vectors
        distances = [
            sum(abs(values[row * width + place] - WANTED[place]) for place in range(width))
            for row in range(len(bids.agents))
        ]
        best = min(range(len(distances)), key=distances.__getitem__)
        goal = RunAgent.Goal(
            epoch=bids.epoch,
            round=bids.round,
            host_instance=bids.host_instance,
            agent=bids.agents[best],
            agent_id=bids.agent_ids[best],
            scene=self._scene,
        )
        self._runs.send_goal_async(goal).add_done_callback(
            lambda done: done.result().get_result_async()
        )


class Listener(Node):
    """Subscribes to calls for bids, as the probe does in the graph of a market."""

    def __init__(self) -> None:
        super().__init__("listener")
        self.create_subscription(CallForBids, "bt_agents/calls", lambda _call: None, EVENTS)


class Host(Node):
    """Answers calls for bids, and publishes the start of a run at each goal."""

    def __init__(self) -> None:
        super().__init__("host")
        self._names = [f"agent_{index:05d}" for index in range(AGENTS)]
        self._ids = array("I", range(1, AGENTS + 1))
        self._vectors = array("d", (v for index in range(AGENTS) for v in profile(index)))
        self._bids = self.create_publisher(Bids, "bt_agents/bids", EVENTS)
        self._status = self.create_publisher(TreeStatus, "agents/status", EVENTS)
        self.create_subscription(CallForBids, "bt_agents/calls", self._bid, EVENTS)
        ActionServer(
            self,
            RunAgent,
            "agents/run",
            self._run,
            feedback_pub_qos_profile=EVENTS,
            result_timeout=5,
            **SERVICES,
        )

    def _bid(self, call: CallForBids) -> None:
        self._bids.publish(
            Bids(
                epoch=call.epoch,
                round=call.round,
                host="/agents",
                host_instance="0123456789ab",
                agents=self._names,
                agent_ids=self._ids,
                vectors=self._vectors,
            )
        )

    def _run(self, handle: Any) -> RunAgent.Result:
        goal = handle.request
        self._status.publish(
            TreeStatus(
                header=Header(stamp=self.get_clock().now().to_msg()),
                epoch=goal.epoch,
                round=goal.round,
                agent=goal.agent,
            )
        )
        handle.succeed()
        return RunAgent.Result(outcome=RunAgent.Result.SUCCEEDED)


PARTS = {"service": Service, "market": Market, "listener": Listener, "host": Host}
"""Parts of a round by the first word of the command line."""


if __name__ == "__main__":
    rclpy.init()
    spin(PARTS[sys.argv[1]]())
