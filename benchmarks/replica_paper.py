# SPDX-License-Identifier: Apache-2.0
"""A replica of the paper's flow in bare rclpy: scene analysis, market, agents and feedback."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Empty, Header

from bare import EVENTS, LATCHED, SERVICES, spin
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import (
    AgentCard,
    Bids,
    CallForBids,
    HostCard,
    MarketStatus,
    Scene,
    SceneValue,
)
from bt_agents_interfaces.srv import CollectFeedback, RegisterHost, SetProfile

AGENTS = {"agent_0": 2.0, "agent_1": 3.0, "agent_2": 4.0}
"""Agent → the age in its profile."""

GIVEN = [3.5, 3.0, 3.0]
"""The prepared feedback, always the same."""

PARAMETERS = ["age", "familiarity", "mood"]
RATE = 0.2
DEADLINE_S = 0.5


class SceneAnalysis(Node):
    """Publishes a scene for every trigger."""

    def __init__(self) -> None:
        super().__init__("scene_layer")
        self._number = 0
        self._scene = self.create_publisher(Scene, "bt_agents/scene", EVENTS)
        self.create_subscription(Empty, "~/trigger", self._trigger, EVENTS)

    def _trigger(self, _message: Empty) -> None:
        self._number += 1
        self._scene.publish(
            Scene(
                header=Header(stamp=self.get_clock().now().to_msg()),
                scene_id=str(self._number),
                person=True,
                values=[SceneValue(name=name, value=3.0) for name in PARAMETERS],
            )
        )


class Marketplace(Node):
    """Calls all registered agents for bids, runs the nearest one, then collects feedback."""

    def __init__(self) -> None:
        super().__init__("marketplace")
        self._round = 0
        self._scene = Scene()
        self._bids: dict[str, list[float]] = {}
        self._actions: dict[str, ActionClient] = {}
        self._calls = self.create_publisher(CallForBids, "bt_agents/calls", EVENTS)
        self._status = self.create_publisher(MarketStatus, "bt_agents/market", LATCHED)
        self._collect = self.create_client(CollectFeedback, "feedback/collect", qos_profile=EVENTS)
        self.create_service(RegisterHost, "~/register", self._register, qos_profile=EVENTS)
        self.create_subscription(Scene, "bt_agents/scene", self._announce, EVENTS)
        self.create_subscription(Bids, "bt_agents/bids", self._take, EVENTS)
        self._deadline = self.create_timer(DEADLINE_S, self._award, autostart=False)

    def _register(self, request: Any, response: Any) -> Any:
        self._actions[request.host] = ActionClient(self, RunAgent, request.run_action, **SERVICES)
        response.accepted, response.agent_ids = True, [len(self._actions)]
        self._status.publish(MarketStatus(agents=len(self._actions)))
        return response

    def _announce(self, scene: Scene) -> None:
        self._round += 1
        self._scene, self._bids = scene, {}
        self._calls.publish(
            CallForBids(
                round=self._round, scene=scene, parameters=PARAMETERS, deadline_s=DEADLINE_S
            )
        )
        self._deadline.reset()

    def _take(self, bid: Bids) -> None:
        if bid.round == self._round:
            self._bids[bid.host] = list(bid.vectors)
            if len(self._bids) == len(self._actions):
                self._award()

    def _award(self) -> None:
        self._deadline.cancel()
        scene = [value.value for value in self._scene.values]
        winner = min(
            self._bids,
            key=lambda one: sum(abs(a - b) for a, b in zip(self._bids[one], scene, strict=True)),
        )
        goal = RunAgent.Goal(round=self._round, agent=winner, scene=self._scene)
        sent = self._actions[winner].send_goal_async(goal)
        sent.add_done_callback(lambda done: self._accepted(winner, done.result()))

    def _accepted(self, winner: str, handle: Any) -> None:
        handle.get_result_async().add_done_callback(lambda _done: self._ended(winner))

    def _ended(self, winner: str) -> None:
        request = CollectFeedback.Request(round=self._round, agent=winner, scene=self._scene)
        collected = self._collect.call_async(request)
        collected.add_done_callback(
            lambda _done: self._status.publish(
                MarketStatus(agents=len(self._actions), finished_scene_id=self._scene.scene_id)
            )
        )


class Agent(Node):
    """Bids with its parameters, runs when told to, and takes new parameters."""

    def __init__(self, name: str, age: float) -> None:
        super().__init__(name)
        self._parameters = [age, 3.0, 3.0]
        self._revision = 0
        self._bids = self.create_publisher(Bids, "bt_agents/bids", EVENTS)
        self._card = self.create_publisher(HostCard, "bt_agents/cards", EVENTS)
        self.create_subscription(CallForBids, "bt_agents/calls", self._bid, EVENTS)
        self.create_service(SetProfile, "~/set_profile", self._set, qos_profile=EVENTS)
        self._action = ActionServer(
            self, RunAgent, "~/run", execute_callback=self._run, result_timeout=2, **SERVICES
        )
        self._market = self.create_client(RegisterHost, "marketplace/register", qos_profile=EVENTS)
        self._look = self.create_timer(0.1, self._register)

    def _register(self) -> None:
        if self._market.service_is_ready():
            self._look.cancel()
            name = self.get_name()
            self._market.call_async(RegisterHost.Request(host=name, run_action=f"{name}/run"))

    def _bid(self, call: CallForBids) -> None:
        name = self.get_name()
        self._bids.publish(
            Bids(round=call.round, host=name, agents=[name], vectors=self._parameters)
        )

    def _run(self, handle: Any) -> RunAgent.Result:
        handle.succeed()
        return RunAgent.Result(outcome=RunAgent.Result.SUCCEEDED)

    def _set(self, request: Any, response: Any) -> Any:
        self._parameters = list(request.values)
        self._revision += 1
        card = AgentCard(name=self.get_name(), current=request.values, revision=self._revision)
        self._card.publish(HostCard(host=self.get_name(), parameters=PARAMETERS, agents=[card]))
        response.accepted = True
        return response


class Feedback(Node):
    """Answers with prepared feedback, which moves the parameters of the agent."""

    def __init__(self) -> None:
        super().__init__("feedback")
        self._parameters = {name: [age, 3.0, 3.0] for name, age in AGENTS.items()}
        # It awaits the agent's answer, which the callback group of the service would block.
        group = ReentrantCallbackGroup()
        self._clients_of = {
            name: self.create_client(
                SetProfile, f"{name}/set_profile", qos_profile=EVENTS, callback_group=group
            )
            for name in AGENTS
        }
        self.create_service(
            CollectFeedback, "~/collect", self._answer, qos_profile=EVENTS, callback_group=group
        )

    async def _answer(self, request: Any, response: Any) -> Any:
        before = self._parameters[request.agent]
        after = [a + RATE * (b - a) for a, b in zip(before, GIVEN, strict=True)]
        self._parameters[request.agent] = after
        await self._clients_of[request.agent].call_async(
            SetProfile.Request(agent=request.agent, values=after)
        )
        response.accepted = response.applied = True
        return response


ROLES: dict[str, Callable[[], list[Node]]] = {
    "scene": lambda: [SceneAnalysis()],
    "market": lambda: [Marketplace()],
    "agents": lambda: [Agent(name, age) for name, age in AGENTS.items()],
    "feedback": lambda: [Feedback()],
}
"""Roles of this module by the command line."""


if __name__ == "__main__":
    rclpy.init()
    spin(*ROLES[sys.argv[1]](), turner=SingleThreadedExecutor())
