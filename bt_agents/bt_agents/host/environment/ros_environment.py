# SPDX-License-Identifier: Apache-2.0
"""The environment of trees over rclpy: goals, requests and topics that never block a tick."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from enum import Enum
from functools import partial
from typing import Any

from rclpy.action import ActionClient
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.task import Future

from bt_agents.engine.environment import GoalRun, Inbox, SkillGoal
from bt_agents.host.environment.feedback_requests import FeedbackRequests
from bt_agents.host.environment.goal import (
    GoalDeadlines,
    GoalTrack,
    RosGoalRun,
    RosRequest,
    Servers,
)
from bt_agents.host.environment.graph_problems import GraphProblems, SilentServers, topic_problem
from bt_agents.host.environment.open_goal_list import OpenGoalList
from bt_agents.host.environment.plugin_node import PluginGoal, RosPluginNode
from bt_agents.host.environment.subscriptions import Heartbeats, LatchedTopic, open_inbox
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import BindingKind
from bt_agents_core.local_time import LocalTime, local_time
from bt_agents_core.open_goals import OpenGoal
from bt_agents_core.ros_names import other_types
from bt_agents_core.scene import SceneSpace
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import RunKey as RunKeyMsg
from bt_agents_language.model.specs import Binding, NodeSpec
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_ros import qos
from bt_agents_ros.discovery import node_of, participants, types_on_graph
from bt_agents_ros.goal_cancellation import GoalCanceller
from bt_agents_ros.types import fill, load_type

COUNT_S = 2.0
"""Time between two counts of the servers that trees may use [s]."""

PURSUED_S = 10.0
"""Time in which the server of a given-up goal may return, so that its end is certain [s]."""

_RUN_TYPE = "bt_agents_interfaces/RunKey"


class _Source(Enum):
    STEADY = 1
    SIMULATED = 2
    NOT_YET = 3


class TreeClock:
    """Returns the trees' time [s]; only differences are meaningful.

    It is steady time, or simulated time under ``use_sim_time``. When simulated time jumps back
    (for example because a bag restarts) or the source changes, the trees' time continues from its
    last value. Simulated time stands still until the first message on ``/clock``.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._source = _Source.STEADY
        self._last = time.monotonic()
        self._offset = 0.0
        self._stopped = False

    def __call__(self) -> float:
        if self._stopped:
            return self._last
        source, raw = self._read()
        if source is not self._source or raw + self._offset < self._last:
            self._source = source
            self._offset = self._last - raw
        self._last = raw + self._offset
        return self._last

    def stop(self) -> None:
        """Stop time from now on."""
        self()
        self._stopped = True

    def advance(self, seconds: float) -> None:
        """Advance the stopped time at once [s]."""
        if self._stopped:
            self._last += seconds

    def go_on(self) -> None:
        """Resume time from where it was stopped."""
        if self._stopped:
            self._stopped = False
            self._source, raw = self._read()
            self._offset = self._last - raw

    def obstacle(self) -> str:
        """Return why time stands still; empty while it passes."""
        source, _ = self._read()
        if source is not _Source.STEADY and not self._node.count_publishers("/clock"):
            return "use_sim_time is set, but nothing publishes /clock"
        if source is _Source.NOT_YET:
            return "use_sim_time is set, but /clock stands at zero"
        return ""

    def _read(self) -> tuple[_Source, float]:
        clock = self._node.get_clock()
        if not clock.ros_time_is_active:
            return _Source.STEADY, time.monotonic()
        now = float(clock.now().nanoseconds) * 1e-9
        return (_Source.SIMULATED if now else _Source.NOT_YET), now


class RosEnvironment:
    """Environment of the trees of one host: clients, publishers and subscriptions of its node.

    Args:
        node: The host's node; it has one client per name.
        wake: Called when something has arrived that a leaf may wait for.
        run_goal: Returns the goal of the current run, None without one. Goals and requests of its
            tree carry the run if their type has fields for it.
        open_goals: List of the sent goals until their end is confirmed.
        slowness: Factor of the time limits for discovery, acceptance and silence of a server.

    Attributes:
        silent_servers: Servers that have not answered the last goal.
        graph_problems: Problems that the graph shows for the actions and topics of trees.
    """

    def __init__(
        self,
        node: Node,
        wake: Callable[[], None],
        *,
        run_goal: Callable[[], RunAgent.Goal | None],
        open_goals: OpenGoalList,
        space: SceneSpace,
        slowness: float = 1.0,
    ) -> None:
        self.clock = TreeClock(node)
        self.silent_servers = SilentServers()
        self.graph_problems = GraphProblems()
        self._node = node
        self._wake = wake
        self._run_goal = run_goal
        self._open_goals = open_goals
        self._space = space
        self._slowness = slowness
        self._deadlines = GoalDeadlines(node)
        self._canceller = GoalCanceller(node)
        self._heartbeats = Heartbeats(node)
        self._clients: dict[tuple[BindingKind, str, str], Any] = {}
        self._publishers: dict[tuple[str, str], Any] = {}
        self._latched: dict[tuple[str, str], LatchedTopic] = {}
        self._watched: set[tuple[str, str]] = set()
        self._feedback: FeedbackRequests | None = None
        self._count_at = 0.0

    def local_time(self) -> LocalTime:
        """Return the local time of the node's clock."""
        return local_time(self._node.get_clock().now().nanoseconds * 1e-9)

    def prepare(self, spec: NodeSpec) -> None:
        """Create what a node will use in advance, so that discovery is over by its first use.

        Errors are logged; the node then fails when it is ticked.
        """
        try:
            resources = type_of(spec).resources(spec)
            if resources.binding is not None:
                self._prepare_binding(resources.binding)
            if resources.feedback:
                self._feedback_requests()
            if resources.latched and resources.topic is not None:
                self._latched_topic(*resources.topic)
        except Exception as error:
            self._node.get_logger().warning(f"{spec.path}, {spec.position}: {error}")

    def retain(self, specs: Iterable[NodeSpec]) -> None:
        """Destroy what none of these nodes use; called while no tree runs.

        A goal without a confirmed end keeps its client until the next call.
        """
        clients, publishers, latched, heartbeats = set(), set(), set(), set()
        for spec in specs:
            resources = type_of(spec).resources(spec)
            if (binding := resources.binding) is not None:
                clients.add((binding.kind, binding.name, binding.type))
                publishers.add((binding.name, binding.type))
                if binding.heartbeat is not None:
                    heartbeats.add((binding.heartbeat.topic, binding.heartbeat.type))
            if resources.topic is not None:
                latched.add(resources.topic)
        in_use = self._deadlines.clients()
        for key in self._clients.keys() - clients:
            client = self._clients[key]
            if client in in_use:
                continue
            del self._clients[key]
            self.graph_problems.forget(self._full_name(key[1]))
            if key[0] is BindingKind.ACTION:
                client.destroy()
            else:
                self._node.destroy_client(client)
        for name in self._publishers.keys() - publishers:
            self._node.destroy_publisher(self._publishers.pop(name))
        for name in self._latched.keys() - latched:
            self._latched.pop(name).close()
        for topic, type_name in self._watched - latched:
            self._watched.remove((topic, type_name))
            self.graph_problems.report(topic, "")
        self._heartbeats.retain(heartbeats)

    def send(self, goal: SkillGoal) -> GoalRun:
        """Send a goal or request.

        Raises:
            Refused: The fields do not fit the type, or the type does not exist.
        """
        goal = _prolonged(goal, self._slowness)
        client = self._client(goal.kind, goal.name, goal.type)
        kind = load_type(goal.type, goal.kind)
        is_action = goal.kind is BindingKind.ACTION
        message = kind.Goal() if is_action else kind.Request()
        fill(message, goal.fields)
        self._name_run(message)
        last_heartbeat = (
            self._heartbeats.subscribe(goal.heartbeat) if goal.heartbeat is not None else None
        )
        on_end = partial(self.silent_servers.ended, goal.name)
        track = GoalTrack(
            goal, time.monotonic, last_heartbeat, on_end, partial(self._other_type, goal)
        )
        reschedule = self._deadlines.reschedule
        run: RosGoalRun | RosRequest
        if is_action:
            run = RosGoalRun(
                client,
                message,
                track,
                **self._following(goal, uuid.uuid4().bytes, client),
                feedback=goal.feedback,
            )
        else:
            run = RosRequest(client, message, track, reschedule=reschedule, wake=self._wake)
        self._deadlines.add(run)
        return run

    def publish(self, goal: SkillGoal) -> None:
        """Publish a message.

        Raises:
            Refused: The fields do not fit the type, or the type does not exist.
        """
        message = load_type(goal.type, BindingKind.TOPIC)()
        fill(message, goal.fields)
        self._publisher(goal.name, goal.type).publish(message)

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> Inbox:
        """Subscribe to a topic; if it is latched, its last earlier message comes first.

        Raises:
            Refused: ``UNKNOWN_TYPE``.
        """
        problem = partial(self.graph_problems.of, topic)
        if latched:
            inbox = self._latched_topic(topic, type_name).open(problem)
        else:
            kind = load_type(type_name, BindingKind.TOPIC)
            inbox = open_inbox(self._node, topic, kind, self._wake, problem)
        self._watched.add((topic, type_name))
        self._look_at_topic(topic, type_name)
        return inbox

    def open_plugin_node(self, path: str) -> RosPluginNode:
        """Return the host's node for the plug-in at a path."""

        def send(
            client: Any, message: Any, goal_id: bytes, name: str, answer: Future, on_feedback: Any
        ) -> PluginGoal:
            self._name_run(message)
            goal = SkillGoal(kind=BindingKind.ACTION, name=name, type="", fields={}, sender=path)
            run = PluginGoal(
                client,
                message,
                GoalTrack(goal, time.monotonic),
                **self._following(goal, goal_id, client),
                answer=answer,
                on_feedback=on_feedback,
            )
            self._deadlines.add(run)
            return run

        return RosPluginNode(self._node, send)

    def log(self, level: str, text: str) -> None:
        """Log a line under the name of the running agent."""
        logger = self._node.get_logger().get_child(self._agent())
        # One call per level: rclpy refuses a line of code that changes its level.
        match level:
            case "error":
                logger.error(text)
            case "warning":
                logger.warning(text)
            case _:
                logger.info(text)

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> GoalRun:
        """Request a change of the running agent's profile from the feedback node."""
        return self._feedback_requests().give(kind, values, reason)

    def close(self) -> None:
        """Destroy the action clients, which a node leaves alone; log undelivered feedback."""
        for (kind, _, _), client in self._clients.items():
            if kind is BindingKind.ACTION:
                client.destroy()
        self._clients.clear()
        if self._feedback is not None:
            self._feedback.outbox.close()

    def _name_run(self, message: Any) -> None:
        """Fill in the run of a goal or a request, if its type has fields for it."""
        goal = self._run_goal()
        if goal is not None and message.get_fields_and_field_types().get("run") == _RUN_TYPE:
            message.run = RunKeyMsg(epoch=goal.epoch, round=goal.round, agent=goal.agent)

    def _agent(self) -> str:
        """Return the name of the agent whose tree runs; empty for none."""
        goal = self._run_goal()
        return str(goal.agent) if goal is not None else ""

    def _prepare_binding(self, binding: Binding) -> None:
        if binding.kind is BindingKind.TOPIC:
            self._publisher(binding.name, binding.type)
        else:
            self._client(binding.kind, binding.name, binding.type)
        if binding.heartbeat is not None:
            self._heartbeats.subscribe(binding.heartbeat)

    def look_again(self) -> None:
        """Look at the graph again, for problems and for publishers of topics."""
        published = {key: latched.look() for key, latched in self._latched.items()}
        for key in self._watched:
            self._look_at_topic(*key, published.get(key))
        if time.monotonic() >= self._count_at:
            self._count_at = time.monotonic() + COUNT_S
            kinds = {self._full_name(name): kind for kind, name, _ in self._clients}
            # Actions of plug-ins have no client here.
            for name in (*kinds, *self.graph_problems.watched - kinds.keys()):
                self._count_servers(kinds.get(name, BindingKind.ACTION), name)

    def _count_servers(self, kind: BindingKind, name: str) -> None:
        """Check before the first goal that one server offers an action or a service."""
        if kind is BindingKind.ACTION:
            self._look(name)
        else:
            # The graph does not say which nodes they are.
            self.graph_problems.look(name, [""] * self._node.count_services(name), kind)

    def _look_at_topic(
        self, topic: str, type_name: str, published: frozenset[str] | None = None
    ) -> None:
        latched = self._latched.get((topic, type_name))
        kept = latched is not None and latched.keeps_message
        if published is None:
            published = types_on_graph(self._node, BindingKind.TOPIC, topic)
        problem = topic_problem(topic, type_name, published, kept=kept)
        self.graph_problems.report(topic, problem)

    def _other_type(self, goal: SkillGoal) -> str:
        """Return in words that the graph shows another type for a goal's server; else empty."""
        other = other_types(goal.type, types_on_graph(self._node, goal.kind, goal.name))
        return f"the graph shows {goal.name} as {other}" if other else ""

    def _look(self, action: str) -> Servers:
        """Return the servers of an action; several servers are a problem."""
        endpoints = self._node.get_publishers_info_by_topic(f"{action}/_action/status")
        return Servers(
            participants=participants(endpoints),
            several=len(endpoints) > 1,
            note=self.graph_problems.look(action, list(map(node_of, endpoints))),
        )

    def _following(self, goal: SkillGoal, goal_id: bytes, client: Any) -> dict[str, Any]:
        """Return the arguments for tracking a goal of an action to its end."""
        action = self._full_name(goal.name)
        return {
            "reschedule": self._deadlines.reschedule,
            "wake": self._wake,
            "identity": OpenGoal(path=goal.sender, action=action, goal_id=goal_id),
            "open_goals": self._open_goals,
            "servers": lambda: self._look(action),
            "earlier_is_ending": lambda: self._deadlines.is_ending(client),
            "pursue": partial(self._canceller.cancel, within_s=PURSUED_S),
            "warn": lambda text: self._node.get_logger().warning(f"{goal.name}: {text}"),
        }

    def _full_name(self, name: str) -> str:
        """Return the full name of an action or a service; rclpy does not remap actions."""
        return str(expand_topic_name(name, self._node.get_name(), self._node.get_namespace()))

    def _client(self, kind: BindingKind, name: str, type_name: str) -> Any:
        key = (kind, name, type_name)
        if key not in self._clients:
            loaded = load_type(type_name, kind)
            if kind is BindingKind.ACTION:
                self._clients[key] = ActionClient(
                    self._node,
                    loaded,
                    name,
                    goal_service_qos_profile=qos.SERVICE,
                    result_service_qos_profile=qos.SERVICE,
                    cancel_service_qos_profile=qos.SERVICE,
                )
            else:
                self._clients[key] = self._node.create_client(
                    loaded, name, qos_profile=qos.SERVICE
                )
        return self._clients[key]

    def _publisher(self, name: str, type_name: str) -> Any:
        key = (name, type_name)
        if key not in self._publishers:
            kind = load_type(type_name, BindingKind.TOPIC)
            self._publishers[key] = self._node.create_publisher(kind, name, qos.EVENTS)
        return self._publishers[key]

    def _latched_topic(self, topic: str, type_name: str) -> LatchedTopic:
        key = (topic, type_name)
        if key not in self._latched:
            kind = load_type(type_name, BindingKind.TOPIC)
            self._latched[key] = LatchedTopic(self._node, topic, kind, self._wake)
        return self._latched[key]

    def _feedback_requests(self) -> FeedbackRequests:
        if self._feedback is None:
            self._feedback = FeedbackRequests(
                self._node, self._wake, run_goal=self._run_goal, space=self._space
            )
        return self._feedback


def _prolonged(goal: SkillGoal, factor: float) -> SkillGoal:
    """Return a goal with longer limits for a slow network, except for its result."""
    heartbeat, timeouts = goal.heartbeat, goal.timeouts
    if heartbeat is not None:
        heartbeat = replace(heartbeat, within_s=heartbeat.within_s * factor)
    return replace(
        goal,
        heartbeat=heartbeat,
        timeouts=replace(
            timeouts, server_s=timeouts.server_s * factor, accept_s=timeouts.accept_s * factor
        ),
    )
