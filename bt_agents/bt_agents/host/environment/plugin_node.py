# SPDX-License-Identifier: Apache-2.0
"""The host's node as plug-ins get it: what they create with it ends with the run."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future

from bt_agents.engine.environment import GoalState
from bt_agents.host.environment.goal import RosGoalRun
from bt_agents_core.field_types import Plain
from bt_agents_ros.types import to_plain

_DESTROYED_BY = {
    f"create_{kind}": f"destroy_{kind}"
    for kind in ("client", "guard_condition", "publisher", "service", "subscription", "timer")
}

_UNANSWERED = (GoalState.UNREACHABLE, GoalState.TIMED_OUT)


class PluginGoal(RosGoalRun):
    """A goal that a behaviour sends through its own action client, tracked like any other.

    It is sent when its server is available. The behaviour gets the handle when the goal is
    accepted or rejected; a cancel by the behaviour is tracked here.

    Args:
        answer: Future that the behaviour got for its goal.
        on_feedback: Feedback callback of the behaviour; None for none.
        how: See :class:`RosGoalRun`.
    """

    def __init__(self, *how: Any, answer: Future, on_feedback: Any, **more: Any) -> None:
        self._answer = answer
        self._on_feedback = on_feedback
        super().__init__(*how, feedback=False, **more)

    def give_up(self) -> None:
        """Give it up at the end of the run; cancelling continues as long as it may exist."""
        with self._transition():
            if not self._track.confirmed:
                self._track.lost("the run is over")

    @property
    def action(self) -> str:
        """Name of its action."""
        return self._identity.action

    def _feedback_callback(self) -> Any:
        return self._on_feedback

    def _answered(self, handle: Any) -> None:
        if self._answer.done():
            return
        cancel = handle.cancel_goal_async

        def cancelled() -> Any:
            # The resulting cancel counts as the one that the track would send.
            self._track.cancel()
            self._track.take_cancel()
            return cancel()

        handle.cancel_goal_async = cancelled
        super()._answered(handle)
        self._answer.set_result(handle)


SendGoal = Callable[[Any, Any, bytes, str, Future, Any], PluginGoal]
"""Makes a goal: client, message, identifier, name of the action, answer, feedback callback."""


class _RememberingNode:
    """A node that remembers the publishers, subscriptions, clients and timers created with it."""

    def __init__(self, node: Node, on_action_client: Callable[[Any], None]) -> None:
        self._node = node
        self._on_action_client = on_action_client
        self._made: list[tuple[str, Any]] = []
        self._action_clients: list[Any] = []

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._node, name)
        destroy = _DESTROYED_BY.get(name)
        if destroy is None:
            return value

        def create(*arguments: Any, **more: Any) -> Any:
            made = value(*arguments, **more)
            self._made.append((destroy, made))
            return made

        return create

    def add_waitable(self, waitable: Any) -> None:
        """Add a waitable; an action client adds itself to its node this way."""
        self._node.add_waitable(waitable)
        if isinstance(waitable, ActionClient):
            self._action_clients.append(waitable)
            self._on_action_client(waitable)

    def remove_waitable(self, waitable: Any) -> None:
        """Remove a waitable; an action client does so when it is destroyed."""
        if waitable in self._action_clients:
            self._action_clients.remove(waitable)
        self._node.remove_waitable(waitable)

    def destroy_all(self) -> None:
        """Destroy everything that was created and still exists."""
        for client in list(self._action_clients):
            client.destroy()
        for destroy, made in reversed(self._made):
            getattr(self._node, destroy)(made)
        self._made.clear()


class RosPluginNode:
    """See :class:`bt_agents.engine.environment.PluginNode`.

    Its action clients never wait for their server in ``setup``; their goals do.

    Args:
        send: Makes a goal.
    """

    def __init__(self, node: Node, send: SendGoal) -> None:
        self._remembering = _RememberingNode(node, self._take_over)
        self._executor = node.executor
        self._send = send
        self._goals: list[PluginGoal] = []
        self._settled: list[PluginGoal] = []

    @property
    def node(self) -> Any:
        return self._remembering

    def open_goals(self) -> int:
        self._settled = [goal for goal in self._settled if not goal.confirmed]
        return len(self._settled) + sum(not goal.confirmed for goal in self._goals)

    def lost(self) -> str:
        for goal in self._goals:
            if goal.state in _UNANSWERED:
                return f"{goal.action} {goal.state.value}: {goal.message}"
        return ""

    def settle(self) -> None:
        for goal in self._goals:
            if not goal.confirmed:
                goal.cancel()
        self._settled += self._goals
        self._goals.clear()

    def plain(self, value: object) -> Plain:
        if hasattr(value, "get_fields_and_field_types"):
            return to_plain(value)
        return value  # type: ignore[return-value]  # the engine checks it

    def close(self) -> None:
        for goal in (*self._settled, *self._goals):
            goal.give_up()
        self._settled.clear()
        self._goals.clear()
        self._remembering.destroy_all()

    def _take_over(self, client: Any) -> None:
        """Track the goals of an action client that a behaviour has created."""
        plain = SimpleNamespace(
            send_goal_async=client.send_goal_async, server_is_ready=client.server_is_ready
        )

        def send(goal: Any, feedback_callback: Any = None, goal_uuid: Any = None) -> Future:
            answer = Future(executor=self._executor)
            goal_id = bytes(goal_uuid.uuid) if goal_uuid is not None else uuid.uuid4().bytes
            self._goals.append(
                self._send(plain, goal, goal_id, client._action_name, answer, feedback_callback)
            )
            return answer

        client.send_goal_async = send
        client.wait_for_server = lambda timeout_sec=None: True
