# SPDX-License-Identifier: Apache-2.0
"""A probe that acts as the market of a host under test, and trees folders for tests."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time
from rclpy.action import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock as ClockMsg

from active_nodes import active_host
from bt_agents.host.market_registration import MARKET_LEASE
from bt_agents.host.node import HostNode
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Bids, CallForBids, MarketHeartbeat, MarketStatus, Run
from bt_agents_interfaces.srv import RegisterHost
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.messages import scene_to_msg
from scripted_server import ScriptedServer
from tree_harness import agent_text as agent_text
from tree_harness import scene, trees_folder

TOKEN = list(range(1, 17))
"""Token by which hosts recognise the goals of this market."""


class Market:
    """Probe that sends a market's messages, one at a time; silent until told to live.

    Attributes:
        epoch: Its epoch; another epoch stands for a restarted market.
        token: Token that it gives hosts, by which they recognise its goals.
        requests: Number of registrations so far.
        refuse: Names of agents that it refuses → reason.
        refuses_host: Reason to refuse every host; empty to accept them.
        award: Round and agent in its heartbeat, from the last goal.
        on_register: Called before a registration is answered.
        bids: Answers to its calls for bids so far.
    """

    def __init__(self, ros: Any) -> None:
        self.ros = ros
        node = ros.node
        self.epoch = "e1"
        self.token = bytes(TOKEN)
        self.requests: list[Any] = []
        self.refuse: dict[str, str] = {}
        self.refuses_host = ""
        self.award = (0, "")
        self.on_register: Callable[[], None] = lambda: None
        self._status = node.create_publisher(MarketStatus, "bt_agents/market", qos.FACT)
        self._calls = node.create_publisher(CallForBids, "bt_agents/calls", qos.EVENTS)
        self.bids = ros.collect(Bids, "bt_agents/bids", qos.EVENTS)
        self.registration = node.create_service(
            RegisterHost, "marketplace/register", self._register, qos_profile=qos.SERVICE
        )
        self.action = ActionClient(
            node,
            RunAgent,
            "agents/run",
            goal_service_qos_profile=qos.SERVICE,
            result_service_qos_profile=qos.SERVICE,
            cancel_service_qos_profile=qos.SERVICE,
        )
        self._runs = node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
        self._heart = node.create_publisher(MarketHeartbeat, "marketplace/heartbeat", qos.EVENTS)
        self._beats = node.create_timer(
            0.05, self.beat, clock=Clock(clock_type=ClockType.STEADY_TIME), autostart=False
        )

    def _register(self, request: Any, response: Any) -> Any:
        self.requests.append(request)
        self.on_register()
        response.accepted = not self.refuses_host
        response.message = self.refuses_host
        response.epoch = self.epoch
        response.token = list(self.token)
        response.reasons = [self.refuse.get(name, "") for name in request.agents]
        response.agent_ids = [
            0 if reason else index for index, reason in enumerate(response.reasons, start=1)
        ]
        return response

    def open(self) -> None:
        """Publish that the market is open."""
        self._status.publish(MarketStatus(epoch=self.epoch))

    def host(self, trees: Path, **options: Any) -> HostNode:
        """Start a host; return it once it is registered."""
        node: HostNode = self.ros.add(make_host(trees, **options))
        self.open()
        self.ros.until(lambda: node.registered)
        return node

    def beat(self) -> None:
        """Publish one heartbeat."""
        number, agent = self.award
        self._heart.publish(MarketHeartbeat(epoch=self.epoch, round=number, agent=agent))

    def live(self) -> None:
        """Publish heartbeats from now on."""
        self._beats.reset()

    def fall_silent(self) -> None:
        """Stop the heartbeats."""
        self._beats.cancel()

    def announce(self, round_number: int, agent: str, event: int = Run.ENDED, **more: Any) -> None:
        """Announce an event of a run, by default its end."""
        run = Run(epoch=self.epoch, round=round_number, agent=agent, event=event, **more)
        self._runs.publish(run)

    def call(self, round_number: int = 1, **changes: Any) -> None:
        """Call for bids."""
        fields = {
            "epoch": self.epoch,
            "round": round_number,
            "scene": scene_to_msg(scene(age=3, familiarity=3, mood=3)),
            "parameters": ["age", "familiarity", "mood"],
            "deadline_s": 0.5,
        }
        self.ros.until(lambda: self._calls.get_subscription_count() > 0)
        self._calls.publish(CallForBids(**fields | changes))

    def goal(self, host: HostNode, agent: str = "talker", **changes: Any) -> RunAgent.Goal:
        """Return a goal for an agent of a host, with some fields changed."""
        member = host.registry.members.get(agent)
        fields = {
            "epoch": self.epoch,
            "round": 1,
            "host_instance": host.instance,
            "agent": agent,
            "agent_id": member.agent_id if member else 1,
            "token": TOKEN,
            "scene": scene_to_msg(scene(age=3, familiarity=3, mood=3)),
        }
        return RunAgent.Goal(**fields | changes)

    def send(self, goal: RunAgent.Goal) -> Any:
        """Send a goal; return its handle once the host has answered."""
        self.ros.until(self.action.server_is_ready)
        self.award = (goal.round, goal.agent)
        future = self.action.send_goal_async(goal)
        self.ros.until(future.done)
        return future.result()

    def refusal(self, goal: RunAgent.Goal) -> str:
        """Send a goal that the host refuses; return the code in the result."""
        answer = self.result(self.send(goal))
        assert answer.status == GoalStatus.STATUS_ABORTED
        assert answer.result.outcome == RunAgent.Result.REFUSED
        assert answer.result.message
        return str(answer.result.code)

    def result(self, handle: Any) -> Any:
        """Wait for the end of a run; return its status and result."""
        future = handle.get_result_async()
        self.ros.until(future.done)
        return future.result()


class Stage:
    """A host and its market, and a server of the skill ``say``.

    Args:
        ros: The nodes of the test.
        host: The host.
        market: The market with which it is registered.
        mouth: The server.
    """

    def __init__(self, ros: Any, host: HostNode, market: Market, mouth: ScriptedServer) -> None:
        self.ros = ros
        self.host = host
        self.market = market
        self.mouth = mouth
        self.until = ros.until

    def run(self, agent: str, **changes: Any) -> Any:
        """Run an agent; return the handle of its goal."""
        return self.market.send(self.market.goal(self.host, agent, **changes))

    def begin(self, agent: str = "talker", **changes: Any) -> Any:
        """Run an agent; return the handle of its goal once it speaks."""
        spoken = len(self.mouth.goals)
        handle = self.run(agent, **changes)
        self.until(lambda: len(self.mouth.goals) > spoken)
        return handle

    def pass_time(self, seconds: float) -> None:
        """Spin the nodes for some time."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end)


class Bag:
    """Publishes simulated time on request."""

    def __init__(self, ros: Any) -> None:
        self._ros = ros
        self._clock = ros.node.create_publisher(ClockMsg, "/clock", qos.SENSOR)

    def play(self, host: HostNode, seconds: int) -> None:
        """Set the time, and wait until the host has it."""

        def told() -> bool:
            self._clock.publish(ClockMsg(clock=Time(sec=seconds)))
            return bool(host.get_clock().now().nanoseconds == seconds * 10**9)

        self._ros.until(told)


def folder(tmp_path: Path, *agents: str) -> Path:
    """Return a trees folder with these agents and the shipped skills and scene."""
    return trees_folder(tmp_path / "trees", {str(i): text for i, text in enumerate(agents)})


def make_host(
    path: Path, parameter_overrides: Sequence[Parameter] = (), **arguments: Any
) -> HostNode:
    """Return a host of the agents of a folder that tolerates a market without heartbeat."""
    overrides = [Parameter(MARKET_LEASE, value=10.0), *parameter_overrides]
    trees = read_trees(path, InstalledInterfaces())
    return active_host(trees, parameter_overrides=overrides, **arguments)


def never_held_up(host: HostNode) -> HostNode:
    """Return the host, which no stall of the machine holds up; else it would skip clean-ups."""
    host._runs._award_monitor.stall._limit_s = math.inf
    return host
