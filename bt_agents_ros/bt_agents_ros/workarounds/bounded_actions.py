# SPDX-License-Identifier: Apache-2.0
"""Refusal of goals, results, feedback and answers that are too large, before they become objects.

rclpy 7.1.6 takes them by the types in the action of an action server or client; this module
replaces these types by stand-ins. Remove it with :mod:`bt_agents_ros.workarounds.bounded_types`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient, ActionServer

from bt_agents_core.errors import Refused
from bt_agents_ros.workarounds.bounded_types import bounded
from bt_agents_ros.workarounds.departed_clients import DepartedClients

_PARTS = frozenset(("goal", "cancel", "result", "feedback", "status"))
"""Parts that an action server or client takes from outside."""

SERVICES: Mapping[str, str] = {
    "goal": "_action/send_goal",
    "cancel": "_action/cancel_goal",
    "result": "_action/get_result",
}
"""Part that an action server takes and answers → the end of the name of its service."""


def take_bounded(waitable: Any, departed: DepartedClients) -> tuple[Any, list[Refused]]:
    """Take the data of a waitable; drop parts of an action server or client that are too large.

    If they are too large, goals and cancel requests are rejected, results are unknown, the futures
    of answers get the :class:`Refused` as their exception, and feedback is lost. Goals and result
    requests of clients that have left are dropped, because no client would follow them; their
    cancel requests are not.

    Returns:
        The data, and the reason for each refused part.
    """
    if isinstance(waitable, ActionServer):
        refuse: Callable[[Any, str, Any, Refused], None] = partial(_refuse_request, departed)
    elif isinstance(waitable, ActionClient):
        refuse = _refuse_answer
    else:
        return waitable.take_data(), []
    if not isinstance(waitable._action_type, SimpleNamespace):
        waitable._action_type = _bounded_action(waitable._action_type)
    data = waitable.take_data()
    found = []
    for part in _PARTS & data.keys():
        taken = data[part]
        origin, message = taken if isinstance(taken, tuple) else (None, taken)
        if isinstance(message, Refused):
            del data[part]
            refuse(waitable, part, origin, message)
            found.append(message)
        elif (
            part in ("goal", "result")
            and isinstance(waitable, ActionServer)
            and departed.have(lambda: waitable._node, SERVICES[part], origin)
        ):
            del data[part]
    return data, found


@cache
def _bounded_action(action: Any) -> Any:
    """Return a copy of an action whose messages and services are stand-ins."""
    services = {
        name: SimpleNamespace(Request=bounded(service.Request), Response=bounded(service.Response))
        for name in ("SendGoalService", "GetResultService", "CancelGoalService")
        for service in [getattr(action.Impl, name)]
    }
    messages = {
        name: bounded(getattr(action.Impl, name))
        for name in ("FeedbackMessage", "GoalStatusMessage")
    }
    return SimpleNamespace(
        Goal=action.Goal,
        Result=action.Result,
        Feedback=action.Feedback,
        Impl=SimpleNamespace(**services, **messages),
    )


def _refuse_request(
    departed: DepartedClients, server: Any, part: str, header: Any, _refused: Refused
) -> None:
    implementation = server._action_type.Impl
    responses = {
        "goal": implementation.SendGoalService.Response,
        "cancel": partial(CancelGoal.Response, return_code=CancelGoal.Response.ERROR_REJECTED),
        "result": partial(
            implementation.GetResultService.Response, status=GoalStatus.STATUS_UNKNOWN
        ),
    }
    send = getattr(server._handle, f"send_{part}_response")
    answer = partial(send, header, responses[part]())
    departed.answer(lambda: server._node, SERVICES[part], header, answer)


def _refuse_answer(client: Any, part: str, sequence_number: Any, refused: Refused) -> None:
    pending = getattr(client, f"_pending_{part}_requests", {})
    future = pending.get(sequence_number)
    if future is not None:
        future.set_exception(refused)
