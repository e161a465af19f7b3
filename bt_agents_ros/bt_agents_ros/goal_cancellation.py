# SPDX-License-Identifier: Apache-2.0
"""Cancellation of goals that another process sent to servers of unknown action types.

Every action server has a service that cancels a goal by its id and a latched topic with the states
of its goals; their types are the same for all actions.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import MOST_OPEN_GOALS, OpenGoal
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import LONGEST_NAME
from bt_agents_interfaces.msg import OpenGoals
from bt_agents_ros import qos
from bt_agents_ros.timers import steady_timer

CANCEL_AGAIN_S = 0.25
"""Time after which a goal is cancelled again [s]: a server on the graph may be dead."""

ANSWERS = 2
"""Number of "unknown goal" answers after which a server can no longer accept the goal."""

ANSWERS_OF_SEVERAL = 8
"""Number of such answers after which none of several servers can, requested in the same time.

A server that was killed and started again counts as several until its lease ends.
"""

MOST_CANCELLED = 500
"""Maximum number of goals to cancel at a time; others are reported as not confirmed."""

_POLL_S = 0.01
_ENDS = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)


class CancelledGoal:
    """State machine of one goal, from its first cancel request to its certain end.

    =========================================== ===============================================
    event                                       what follows
    =========================================== ===============================================
    its server is there                         cancel, again every :data:`CANCEL_AGAIN_S`, more
                                                often if there may be several
    a list of states with its end               ended
    answer: unknown, :data:`ANSWERS` in a row   ended; a single one may mean that the server has
                                                not accepted it yet
    the same, and there may be several servers  ended, if :data:`ANSWERS_OF_SEVERAL` in a row say
                                                so, the last of them after ``accepted_by``: each
                                                answer may come from another server
    answer: terminated, twice in a row, while   ended long ago; without a list it may as well be
    the list of states is without it            told to stop already
    any other answer, or none                   nothing: it may end by itself
    =========================================== ===============================================

    Args:
        accepted_by: When the last of several servers has accepted the goal, if at all, steady time
            [s]; None if it has one server.

    Attributes:
        ended: Whether its server no longer works on it.
    """

    def __init__(self, accepted_by: float | None = None) -> None:
        self.ended = False
        self._accepted_by = -math.inf if accepted_by is None else accepted_by
        self._answers = ANSWERS if accepted_by is None else ANSWERS_OF_SEVERAL
        self._again_s = CANCEL_AGAIN_S * ANSWERS / self._answers
        self._gone = 0
        self._is_listed: bool | None = None
        self._cancel_at = 0.0

    def take_cancel(self, now: float) -> bool:
        """Return whether to send a cancel request now, if the server is there; steady time [s]."""
        due = not self.ended and now >= self._cancel_at
        if due:
            self._cancel_at = now + self._again_s
        return due

    def on_answer(self, return_code: int, now: float) -> None:
        """Handle the answer to a cancel request, as in ``CancelGoal.srv``; steady time [s]."""
        terminated = return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
        is_gone = return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID or (
            terminated and self._is_listed is False
        )
        self._gone = self._gone + 1 if is_gone else 0
        self.ended = self.ended or (self._gone >= self._answers and now >= self._accepted_by)

    def on_states(self, status: int | None) -> None:
        """Handle a list of states by the state of the goal; None if the list does not have it."""
        self._is_listed = status is not None
        self.ended = self.ended or status in _ENDS


@dataclass(eq=False, kw_only=True)
class _Server:
    """Client and subscription for the server of one action, and its goals."""

    client: Any
    states: Any
    goals: list[tuple[OpenGoal, CancelledGoal]] = field(default_factory=list)
    pending: list[Any] = field(default_factory=list)


@dataclass(eq=False, kw_only=True)
class _Cancellation:
    """Goals that are cancelled together.

    Attributes:
        due: When to give up, steady time [s].
        overdue: True once a poll has found it overdue; the next poll decides, because after a
            stall the timer fires before messages arrive.
    """

    goals: list[tuple[OpenGoal, CancelledGoal]]
    servers: list[_Server]
    due: float
    on_end: Callable[[tuple[OpenGoal, ...]], None]
    overdue: bool = False


class GoalCanceller:
    """Cancels goals at their servers; use it from the executor's thread only."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._open: list[_Cancellation] = []
        self._timer = steady_timer(node, _POLL_S, self._poll, running=False)

    def cancel(
        self,
        goals: Sequence[OpenGoal],
        *,
        within_s: float,
        accepted_by: float | None = None,
        on_end: Callable[[tuple[OpenGoal, ...]], None],
    ) -> None:
        """Cancel goals, and call back once.

        The callback comes as soon as all have ended, and ``within_s`` seconds from now at the
        latest. ``on_end`` takes the goals whose end is not confirmed. ``accepted_by`` is that of
        :class:`CancelledGoal`.
        """
        tracked = [(goal, CancelledGoal(accepted_by)) for goal in goals]
        room = MOST_CANCELLED - sum(len(one.goals) for one in self._open)
        servers: dict[str, _Server] = {}
        for goal, track in tracked[: max(0, room)]:
            if goal.action not in servers:
                servers[goal.action] = self._connect(goal.action)
            servers[goal.action].goals.append((goal, track))
        self._open.append(
            _Cancellation(
                goals=tracked,
                servers=list(servers.values()),
                due=time.monotonic() + within_s,
                on_end=on_end,
            )
        )
        self._timer.reset()

    def _connect(self, action: str) -> _Server:
        client = self._node.create_client(
            CancelGoal, f"{action}/_action/cancel_goal", qos_profile=qos.SERVICE
        )
        server = _Server(client=client, states=None)
        server.states = self._node.create_subscription(
            GoalStatusArray, f"{action}/_action/status", partial(_on_states, server), qos.FACT
        )
        return server

    def _poll(self) -> None:
        now = time.monotonic()
        for cancellation in list(self._open):
            for server in cancellation.servers:
                self._send(server, now)
            unconfirmed = tuple(goal for goal, track in cancellation.goals if not track.ended)
            if not unconfirmed or (now >= cancellation.due and cancellation.overdue):
                self._end(cancellation, unconfirmed)
            cancellation.overdue = now >= cancellation.due
        if not self._open:
            self._timer.cancel()

    def _send(self, server: _Server, now: float) -> None:
        if not server.client.service_is_ready():
            return
        for goal, track in server.goals:
            if track.take_cancel(now):
                request = CancelGoal.Request()
                request.goal_info.goal_id.uuid = list(goal.goal_id)
                future = server.client.call_async(request)
                server.pending.append(future)
                future.add_done_callback(partial(_on_answer, server, track))

    def _end(self, cancellation: _Cancellation, unconfirmed: tuple[OpenGoal, ...]) -> None:
        self._open.remove(cancellation)
        for server in cancellation.servers:
            for future in server.pending:
                server.client.remove_pending_request(future)
            self._node.destroy_client(server.client)
            self._node.destroy_subscription(server.states)
        cancellation.on_end(unconfirmed)


def open_goals_from_msg(message: OpenGoals) -> tuple[OpenGoal, ...]:
    """Return the goals that a host has open.

    Raises:
        Refused: ``TOO_LONG``, ``TOO_MANY`` or ``BAD_GOAL``.
    """
    for name in (message.host, message.host_instance, message.heartbeat):
        if len(name) > LONGEST_NAME:
            raise Refused(
                RefusalCode.TOO_LONG,
                f"a host, its start or its heartbeat has a name of {len(name)} characters, "
                f"expected {LONGEST_NAME} at most",
            )
    if len(message.goals) > MOST_OPEN_GOALS:
        raise Refused(
            RefusalCode.TOO_MANY,
            f"a host names {len(message.goals)} open goals, expected {MOST_OPEN_GOALS} at most",
        )
    return tuple(
        OpenGoal(path=one.path, action=one.action, goal_id=bytes(one.goal_id))
        for one in message.goals
    )


def _on_answer(server: _Server, track: CancelledGoal, future: Any) -> None:
    if future not in server.pending:
        return
    server.pending.remove(future)
    # An unreadable answer is no answer.
    if not future.cancelled() and future.exception() is None and future.result() is not None:
        track.on_answer(future.result().return_code, time.monotonic())


def _on_states(server: _Server, message: GoalStatusArray) -> None:
    states = {bytes(one.goal_info.goal_id.uuid): one.status for one in message.status_list}
    for goal, track in server.goals:
        track.on_states(states.get(goal.goal_id))
