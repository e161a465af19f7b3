# SPDX-License-Identifier: Apache-2.0
"""The world of trees over rclpy: goals, requests and topics that never block a tick."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.node import Node

from bt_agents.engine.world import GIVE_FEEDBACK, Clock, Goal, GoalRun, GoalState, Inbox
from bt_agents.errors import Refused
from bt_agents.feedback import Kind
from bt_agents.language.specs import BindingKind, Plain
from bt_agents.ros import qos
from bt_agents.ros.interfaces import fill, load_type, to_plain
from bt_agents.scene import SceneSpace
from bt_agents_interfaces.srv import GiveFeedback

SERVER_LIMIT_S = 3.0
"""How long a server may take to be found and to answer whether it takes a goal."""

REPLY_LIMIT_S = 10.0
"""How long a service may take to answer."""

_GIVE_FEEDBACK_TYPE = "bt_agents_interfaces/srv/GiveFeedback"

_ENDS = {
    GoalStatus.STATUS_SUCCEEDED: GoalState.SUCCEEDED,
    GoalStatus.STATUS_CANCELED: GoalState.CANCELLED,
    GoalStatus.STATUS_ABORTED: GoalState.ABORTED,
}


class RosWorld:
    """What the trees of one host reach through its node.

    Args:
        node: The host's node; clients are made once a name and kept.
        wake: Called when something has arrived that a leaf may wait for.
        space: The scene parameters.
        agent: Returns the name of the agent whose tree is running.
    """

    def __init__(
        self,
        node: Node,
        wake: Callable[[], None],
        *,
        space: SceneSpace,
        agent: Callable[[], str],
    ) -> None:
        self._node = node
        self._wake = wake
        self._space = space
        self._agent = agent
        self._clients: dict[tuple[BindingKind, str, str], Any] = {}
        self._publishers: dict[tuple[str, str], Any] = {}

    @property
    def clock(self) -> Clock:
        """The simulated time under ``use_sim_time``, else one that no clock setting can move."""
        if self._node.get_parameter("use_sim_time").value:
            return lambda: float(self._node.get_clock().now().nanoseconds) * 1e-9
        return time.monotonic

    def prepare(self, kind: BindingKind, name: str, type_name: str) -> None:
        """Make the client or publisher ahead of its first use, so that discovery is over by then.

        Raises:
            Refused: ``UNKNOWN_TYPE``.
        """
        if kind is BindingKind.TOPIC:
            self._publisher(name, type_name)
        else:
            self._client(kind, name, type_name)

    def prepare_feedback(self) -> None:
        """Make the client of the feedback service ahead of its first use."""
        self._client(BindingKind.SERVICE, GIVE_FEEDBACK, _GIVE_FEEDBACK_TYPE)

    def send(self, goal: Goal) -> GoalRun:
        """Send a goal or request.

        Raises:
            Refused: The fields do not fit the type, or there is no such type.
        """
        client = self._client(goal.kind, goal.name, goal.type)
        kind = load_type(goal.type, goal.kind)
        if goal.kind is BindingKind.ACTION:
            message = kind.Goal()
            fill(message, goal.fields)
            return _ActionRun(client, message, goal.name, self._wake)
        message = kind.Request()
        fill(message, goal.fields)
        return _ServiceRun(client, message, goal.name, self._wake)

    def publish(self, goal: Goal) -> None:
        """Publish a message.

        Raises:
            Refused: The fields do not fit the type, or there is no such type.
        """
        message = load_type(goal.type, BindingKind.TOPIC)()
        fill(message, goal.fields)
        self._publisher(goal.name, goal.type).publish(message)

    def watch(self, topic: str, type_name: str) -> Inbox:
        """Listen to a topic.

        Raises:
            Refused: ``UNKNOWN_TYPE``.
        """
        return _TopicInbox(self._node, topic, load_type(type_name, BindingKind.TOPIC), self._wake)

    def log(self, level: str, text: str) -> None:
        """Write a line into the log, under the name of the running agent."""
        logger = self._node.get_logger().get_child(self._agent())
        # One call a level: rclpy refuses a line of code that changes its level.
        match level:
            case "error":
                logger.error(text)
            case "warning":
                logger.warning(text)
            case _:
                logger.info(text)

    def give_feedback(self, kind: Kind, values: Mapping[str, float], reason: str) -> GoalRun:
        """Ask the feedback node for a change of the running agent's profile."""
        direct = kind is Kind.DIRECT
        request = GiveFeedback.Request(
            agent=self._agent(),
            kind=int(kind),
            values=[values.get(name, math.nan) for name in self._space.names] if direct else [],
            source="tree",
            reason=reason,
        )
        client = self._client(BindingKind.SERVICE, GIVE_FEEDBACK, _GIVE_FEEDBACK_TYPE)
        return _FeedbackRun(client, request, GIVE_FEEDBACK, self._wake)

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


class _RosRun:
    """What goals and requests have in common: a state that callbacks and polls move on."""

    def __init__(self, name: str, wake: Callable[[], None]) -> None:
        self.message = ""
        self.result: Mapping[str, Plain] = {}
        self._name = name
        self._wake = wake
        self._state = GoalState.PENDING
        self._deadline = time.monotonic() + SERVER_LIMIT_S

    @property
    def state(self) -> GoalState:
        """Where it is now; looking also notices a server that appeared or a time that is up."""
        if not self._state.ended:
            self._poll(time.monotonic())
        return self._state

    def _poll(self, now: float) -> None:
        raise NotImplementedError

    def _end(self, state: GoalState, message: str = "") -> None:
        if not self._state.ended:
            self._state = state
            self.message = message
            self._wake()


class _ActionRun(_RosRun):
    def __init__(self, client: Any, goal: Any, name: str, wake: Callable[[], None]) -> None:
        super().__init__(name, wake)
        self._client = client
        self._goal = goal
        self._sent = False
        self._handle: Any = None
        self._cancel_asked = False
        self._poll(time.monotonic())

    def cancel(self) -> None:
        if self._cancel_asked or self._state.ended:
            return
        self._cancel_asked = True
        if not self._sent:
            self._end(GoalState.CANCELLED, "stopped before it was sent")
        elif self._handle is not None:
            self._handle.cancel_goal_async()

    def _poll(self, now: float) -> None:
        if self._state is GoalState.ACTIVE:
            self._watch_server(now)
        elif not self._sent and self._client.server_is_ready():
            self._sent = True
            future = self._client.send_goal_async(self._goal)
            future.add_done_callback(self._answered)
        elif now >= self._deadline:
            found = "did not answer" if self._sent else "is not there"
            self._end(GoalState.UNREACHABLE, f"{found} within {SERVER_LIMIT_S:g} s")

    def _watch_server(self, now: float) -> None:
        """End a goal whose server has left the graph: its result would be waited for for ever."""
        if self._client.server_is_ready():
            self._deadline = now + SERVER_LIMIT_S
        elif now >= self._deadline:
            self._end(GoalState.UNREACHABLE, f"has been gone for {SERVER_LIMIT_S:g} s")

    def _answered(self, future: Any) -> None:
        if future.exception() is not None:
            self._end(GoalState.UNREACHABLE, str(future.exception()))
            return
        self._handle = future.result()
        if not self._handle.accepted:
            self._end(GoalState.REJECTED)
            return
        self._handle.get_result_async().add_done_callback(self._ended)
        if self._state.ended or self._cancel_asked:
            # Given up or cancelled before acceptance: the server must not go on unseen.
            self._handle.cancel_goal_async()
        if not self._state.ended:
            self._state = GoalState.ACTIVE

    def _ended(self, future: Any) -> None:
        if future.exception() is not None:
            self._end(GoalState.UNREACHABLE, str(future.exception()))
            return
        response = future.result()
        self.result = _plain(response.result)
        self._end(_ENDS.get(response.status, GoalState.ABORTED))


class _ServiceRun(_RosRun):
    def __init__(self, client: Any, request: Any, name: str, wake: Callable[[], None]) -> None:
        super().__init__(name, wake)
        self._client = client
        self._request = request
        self._future: Any = None
        self._poll(time.monotonic())

    def cancel(self) -> None:
        self._forget()
        self._end(GoalState.CANCELLED, "stopped before the answer")

    def _poll(self, now: float) -> None:
        if self._future is None and self._client.service_is_ready():
            self._deadline = now + REPLY_LIMIT_S
            self._state = GoalState.ACTIVE
            self._future = self._client.call_async(self._request)
            self._future.add_done_callback(self._answered)
        elif now >= self._deadline:
            if self._future is None:
                self._end(GoalState.UNREACHABLE, f"is not there within {SERVER_LIMIT_S:g} s")
            else:
                self._forget()
                self._end(GoalState.UNREACHABLE, f"no answer within {REPLY_LIMIT_S:g} s")

    def _forget(self) -> None:
        if self._future is not None:
            self._client.remove_pending_request(self._future)

    def _answered(self, future: Any) -> None:
        if future.exception() is not None:
            self._end(GoalState.ABORTED, str(future.exception()))
        elif future.result() is not None:
            self._take(future.result())

    def _take(self, response: Any) -> None:
        self.result = _plain(response)
        self._end(GoalState.SUCCEEDED)


class _FeedbackRun(_ServiceRun):
    def _take(self, response: Any) -> None:
        if response.accepted:
            super()._take(response)
        else:
            self._end(GoalState.REJECTED, response.message or response.code)


class _TopicInbox:
    _DEPTH = 100

    def __init__(self, node: Node, topic: str, kind: Any, wake: Callable[[], None]) -> None:
        self._node = node
        self._messages: deque[Any] = deque(maxlen=self._DEPTH)
        self._wake = wake
        self._subscription: Any = node.create_subscription(kind, topic, self._take_in, qos.SENSOR)

    def _take_in(self, message: Any) -> None:
        self._messages.append(message)
        self._wake()

    def take(self) -> Mapping[str, Plain] | None:
        return _plain(self._messages.popleft()) if self._messages else None

    def close(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None


def _plain(message: Any) -> Mapping[str, Plain]:
    try:
        plain: Mapping[str, Plain] = to_plain(message)
    except Refused:
        return {}
    return plain
