# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for the rest of the system in measurements of runs: a market, a skill, a face."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.action import ActionClient, ActionServer
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Bool, Empty, Float64, String

from bare import EVENTS, LATCHED, SERVICES
from bare_runs import SENSOR
from bt_agents_interfaces.action import RunAgent, Say
from bt_agents_interfaces.msg import (
    AgentCard,
    Feedback,
    HostCard,
    MarketHeartbeat,
    MarketStatus,
    MoodRule,
    Profiles,
    Run,
    Scene,
    SceneValue,
    StatusChange,
    TreeStatus,
)
from bt_agents_interfaces.srv import RegisterHost, SetProfile
from processes import Graph

EPOCH = "bench"
_TOKEN = list(range(1, 17))
PARAMETERS = ("age", "familiarity", "mood")
MIDDLE = [3.0, 3.0, 3.0]
BEAT_S = 0.2
TRIES, TRY_S = 60, 1.0
SETTLE_S = 0.5
"""Time until all nodes know of new processes [s]."""


def scene(scene_id: str = "s1") -> Scene:
    """Return a scene with the middle value of every parameter."""
    values = [SceneValue(name=name, value=3.0, origin=SceneValue.GIVEN) for name in PARAMETERS]
    return Scene(scene_id=scene_id, person=True, values=values)


class Market:
    """The parts of a market that a host needs, played by the probe of a graph."""

    def __init__(self, graph: Graph) -> None:
        self.hosts: dict[str, Any] = {}
        self._round = 0
        self._agent = ""
        node = graph.probe
        self._status = node.create_publisher(MarketStatus, "bt_agents/market", LATCHED)
        self._heart = node.create_publisher(MarketHeartbeat, "marketplace/heartbeat", EVENTS)
        node.create_service(
            RegisterHost, "marketplace/register", self._register, qos_profile=EVENTS
        )
        node.create_timer(BEAT_S, self._beat)
        self._status.publish(MarketStatus(epoch=EPOCH))

    def _register(self, request: Any, response: Any) -> Any:
        self.hosts[request.host] = request
        response.accepted, response.epoch, response.token = True, EPOCH, _TOKEN
        response.reasons = [""] * len(request.agents)
        response.agent_ids = list(range(1, len(request.agents) + 1))
        return response

    def _beat(self) -> None:
        self._heart.publish(MarketHeartbeat(epoch=EPOCH, round=self._round, agent=self._agent))

    def goal(self, host: str, agent: str) -> RunAgent.Goal:
        """Return the goal of the next round."""
        self._round, self._agent = self._round + 1, agent
        goal = RunAgent.Goal(epoch=EPOCH, round=self._round, agent=agent, scene=scene())
        if host:
            entry = self.hosts[host]
            goal.host_instance = entry.host_instance
            goal.token = _TOKEN
            goal.agent_id = list(entry.agents).index(agent) + 1
        return goal


class Runs:
    """Starts and cancels runs of one host, ours or a bare one.

    Args:
        graph: Graph of the host.
        market: Market that makes the goals; None for a bare host.
        host: Name of the host's node.
    """

    def __init__(self, graph: Graph, market: Market | None, host: str) -> None:
        self.graph = graph
        self._market = market
        self._host = f"/{host}"
        self._action = ActionClient(graph.probe, RunAgent, f"{host}/run", **SERVICES)
        if market is not None:
            graph.until(lambda: self._host in market.hosts, f"{host} is registered")
        graph.until_matched(self._action)

    def start(self, agent: str) -> Any:
        """Start a run; return its handle after its first feedback."""
        heard: list[Any] = []
        if self._market is not None:
            goal = self._market.goal(self._host, agent)
        else:
            goal = RunAgent.Goal(epoch=EPOCH, agent=agent, host_instance="0" * 12, scene=scene())
        sent = self._action.send_goal_async(goal, feedback_callback=heard.append)
        self.graph.until(sent.done, "the answer to a goal")
        assert sent.result().accepted
        self.graph.until(lambda: heard, "the first feedback")
        return sent.result()

    def cancel(self, handle: Any) -> float:
        """Cancel a run; return the time until its end is known [s]."""
        result = handle.get_result_async()
        self.graph.rest(0.002)
        began = time.perf_counter()
        handle.cancel_goal_async()
        self.graph.until(result.done, "the result")
        took = time.perf_counter() - began
        assert result.result().result.outcome == RunAgent.Result.CANCELLED, result.result()
        return took


def told(graph: Graph, tell: Callable[[], None], condition: Callable[[], Any]) -> float:
    """Repeat a message until it has an effect, because readings may be lost.

    Returns:
        When it was last sent [s].

    Raises:
        RuntimeError: It never has an effect.
    """
    for _ in range(TRIES):
        began = time.time()
        tell()
        while True:
            graph.turn()
            if condition():
                return began
            if time.time() >= began + TRY_S:
                break
    raise RuntimeError(f"{graph.name}: what was told {TRIES} times has no effect")


class Told:
    """Collects the messages of a topic, each with the time when it was published [s].

    Args:
        node: Node that subscribes.
        kind: Class of the messages.
        topic: Name of the topic.
        profile: Quality of service.
    """

    def __init__(self, node: Node, kind: Any, topic: str, profile: Any) -> None:
        self.heard: list[tuple[Any, float]] = []

        def take(message: Any, info: Mapping[str, int]) -> None:
            self.heard.append((message, info["source_timestamp"] * 1e-9))

        self.subscription = node.create_subscription(kind, topic, take, profile)


Begin = Callable[[str], Callable[[], None]]


class Results:
    """Delivers messages and goal results that the leaves of a host, ours or a bare one, wait for.

    Args:
        graph: Graph of the host.
        host: Name of the host's node.
        begin: Begins a run of an agent; returns a function that waits for its end.
    """

    def __init__(self, graph: Graph, host: str, begin: Begin) -> None:
        self._graph = graph
        self._begin = begin
        self._goal: Any = None
        self._ended: Any = None
        node = graph.probe
        self._heard = node.create_publisher(String, "heard", SENSOR)
        self._status = Told(node, TreeStatus, f"{host}/status", EVENTS)
        ActionServer(node, Say, "say", execute_callback=self._say, result_timeout=2, **SERVICES)
        graph.until_matched(self._status.subscription)

    async def _say(self, goal: Any) -> Say.Result:
        self._goal, self._ended = goal, Future(executor=self._graph.probe.executor)
        await self._ended
        return Say.Result()

    def topic(self, pause_s: float) -> float:
        """Publish a message; return the time until a tick has used it [s]."""
        end = self._begin("listener")
        self._graph.until_matched(self._heard)
        self._graph.rest(pause_s)
        self._status.heard.clear()
        began = told(self._graph, lambda: self._heard.publish(String(data="now")), self._seen)
        return self._took(began, end)

    def action(self, pause_s: float) -> float:
        """End a goal; return the time until a tick has seen the end [s]."""
        self._goal = None
        end = self._begin("speaker")
        self._graph.until(lambda: self._goal is not None, "the goal of a leaf")
        self._graph.rest(pause_s)
        self._status.heard.clear()
        began = time.time()
        self._goal.succeed()
        self._ended.set_result(None)
        self._graph.until(self._seen, "a tick")
        return self._took(began, end)

    def _seen(self) -> list[TreeStatus]:
        """Return the ticks so far that have seen an end; a bare host sends no nodes."""
        return [
            message
            for message, _ in self._status.heard
            if not message.changes or message.changes[-1].status == StatusChange.SUCCESS
        ]

    def _took(self, began: float, end: Callable[[], None]) -> float:
        stamp = self._seen()[0].header.stamp
        end()
        return float(stamp.sec + stamp.nanosec * 1e-9 - began)


class Moods:
    """Plays the market and a host for the scene layer and the feedback node, and a face.

    Args:
        graph: Graph of these nodes.
        bare: True for bare nodes, which need no market.
    """

    def __init__(self, graph: Graph, *, bare: bool) -> None:
        self._graph = graph
        self._bare = bare
        self._round = 0
        node = graph.probe
        self._valence = node.create_publisher(Float64, "person/valence", SENSOR)
        self._person = node.create_publisher(Bool, "person/present", SENSOR)
        self._feedback = Told(node, Feedback, "bt_agents/feedback", EVENTS)
        self._live = Told(node, Scene, "bt_agents/scene/live", SENSOR)
        graph.until_matched(self._valence, self._feedback.subscription, self._live.subscription)
        if bare:
            return
        graph.until_matched(self._person)
        self._runs = node.create_publisher(Run, "bt_agents/runs", LATCHED)
        cards = node.create_publisher(HostCard, "bt_agents/cards", LATCHED)
        node.create_service(SetProfile, "agents/set_profile", self._set, qos_profile=EVENTS)
        current = Told(node, Profiles, "bt_agents/profiles", LATCHED)
        graph.until_matched(self._runs, count=2)
        rule = MoodRule(when="mood.change >= 0.5", give=MoodRule.POSITIVE)
        card = AgentCard(
            name="a", profile=MIDDLE, current=MIDDLE, learning_rate=0.01, rules=[rule]
        )
        cards.publish(
            HostCard(host="/agents", host_instance="i", parameters=PARAMETERS, agents=[card])
        )
        graph.until(lambda: current.heard, "the card is known")

    def _set(self, _request: Any, response: Any) -> Any:
        response.accepted = True
        return response

    def _run(self, event: int) -> None:
        self._runs.publish(
            Run(
                epoch=EPOCH,
                round=self._round,
                event=event,
                scene=scene(f"s{self._round}"),
                agent="a",
                host="/agents",
                host_instance="i",
            )
        )

    def see(self, pause_s: float) -> float:
        """Change the mood; return the time until its feedback is applied [s]."""
        graph = self._graph
        if not self._bare:
            self._round += 1
            self._run(Run.STARTED)
            self._live.heard.clear()
            graph.until(
                lambda: any(m.scene_id == f"s{self._round}" for m, _ in self._live.heard), "live"
            )
        self._live.heard.clear()
        told(
            graph,
            lambda: self._face(0.0),
            lambda: any(m.values[2].value == MIDDLE[2] for m, _ in self._live.heard),
        )
        graph.rest(pause_s)
        self._feedback.heard.clear()
        began = told(graph, lambda: self._face(1.0), lambda: self._feedback.heard)
        took = self._feedback.heard[0][1] - began
        if not self._bare:
            self._run(Run.ENDED)
        return took

    def _face(self, valence: float) -> None:
        self._valence.publish(Float64(data=valence))
        self._person.publish(Bool(data=True))


class Cycle:
    """Triggers scenes, and waits until the winner's profile has moved.

    Args:
        graph: Graph of the system.
        agents: Number of agents.
    """

    def __init__(self, graph: Graph, agents: int) -> None:
        self._graph = graph
        node = graph.probe
        self._trigger = node.create_publisher(Empty, "scene_layer/trigger", EVENTS)
        self._cards = Told(node, HostCard, "bt_agents/cards", EVENTS)
        self._market = Told(node, MarketStatus, "bt_agents/market", LATCHED)
        graph.until_up()
        graph.until_matched(self._trigger, self._cards.subscription)
        graph.until(lambda: any(m.agents == agents for m, _ in self._market.heard), "registered")
        graph.rest(SETTLE_S)

    def once(self, pause_s: float) -> float:
        """Complete one cycle for a scene; return its time [s]."""
        graph = self._graph
        graph.rest(pause_s)
        self._cards.heard.clear()
        self._market.heard.clear()
        began = time.time()
        self._trigger.publish(Empty())
        graph.until(lambda: self._cards.heard, "a profile that has moved")
        graph.until(
            lambda: (
                self._market.heard
                and self._market.heard[-1][0].state == MarketStatus.IDLE
                and self._market.heard[-1][0].finished_scene_id
            ),
            "the scene is over",
        )
        return self._cards.heard[0][1] - began
