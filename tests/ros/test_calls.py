# SPDX-License-Identifier: Apache-2.0
"""Service calls: one outcome each, whatever happens to the server and to other calls."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Empty

from bt_agents_interfaces.srv import Analyze
from bt_agents_ros import qos
from bt_agents_ros.calls import REPEAT_S, Calls


class Caller:
    """Makes calls, and records the outcome of each."""

    def __init__(self, ros: Any, kind: Any = Empty) -> None:
        self.calls = Calls(ros.node)
        self.kind = kind
        self.client = ros.node.create_client(kind, "somebody", qos_profile=qos.SERVICE)
        self.ends: list[str] = []

    def call(
        self,
        deadline_s: float,
        also: Callable[[], object] = lambda: None,
        discovery_s: float = math.inf,
        **fields: Any,
    ) -> None:
        def failed(reason: str) -> None:
            self.ends.append(reason)
            also()

        self.calls.call(
            self.client,
            self.kind.Request(**fields),
            deadline_s=deadline_s,
            on_answer=lambda _: self.ends.append("answered"),
            on_failure=failed,
            discovery_s=discovery_s,
        )


class SlowServer:
    """A server on its own node, which answers no request before its release."""

    def __init__(self, ros: Any) -> None:
        self.asked: list[Any] = []
        self._released = Future(executor=ros.executor)
        node = ros.add(rclpy.create_node("server"))
        node.create_service(Empty, "somebody", self._answer, qos_profile=qos.SERVICE)

    async def _answer(self, request: Any, answer: Any) -> Any:
        self.asked.append(request)
        await self._released
        return answer

    def release(self) -> None:
        self._released.set_result(None)


def test_call_finds_server_that_starts_before_deadline(ros: Any) -> None:
    caller = Caller(ros)
    caller.call(30.0)
    ros.turns()
    ros.node.create_service(Empty, "somebody", lambda _, answer: answer, qos_profile=qos.SERVICE)
    ros.until(lambda: caller.ends)
    ros.turns()
    assert caller.ends == ["answered"]


@pytest.mark.parametrize(("deadline_s", "discovery_s"), [(0.1, math.inf), (3600.0, 0.1)])
def test_call_without_server_fails_at_earlier_limit(
    ros: Any, deadline_s: float, discovery_s: float
) -> None:
    caller = Caller(ros)
    caller.call(deadline_s, discovery_s=discovery_s)
    ros.until(lambda: caller.ends)
    ros.turns()
    assert caller.ends == ["somebody is not there"]


def test_discovery_limit_does_not_end_waiting_call(ros: Any) -> None:
    server, caller, other = SlowServer(ros), Caller(ros), Caller(ros)
    ros.until(caller.client.service_is_ready)
    caller.call(3600.0, discovery_s=0.1)
    other.client = ros.node.create_client(Empty, "nobody", qos_profile=qos.SERVICE)
    other.call(0.3)
    ros.until(lambda: other.ends)
    assert caller.ends == []
    server.release()
    ros.until(lambda: caller.ends)
    assert caller.ends == ["answered"]


def test_late_response_to_only_request_is_ignored(ros: Any) -> None:
    server, caller = SlowServer(ros), Caller(ros)
    ros.until(caller.client.service_is_ready)
    caller.call(3 * REPEAT_S)
    ros.until(lambda: caller.ends)
    assert len(server.asked) == 1, "a request without an id is sent once"
    server.release()
    ros.turns()
    assert caller.ends == ["somebody did not answer in time"]


def test_raising_failure_callback_does_not_block_other_calls(ros: Any) -> None:
    def stumble() -> None:
        raise RuntimeError("stumbled")

    caller = Caller(ros)
    caller.call(0.1, stumble)
    caller.call(0.1)
    with pytest.raises(RuntimeError, match="stumbled"):
        ros.until(lambda: False, 10.0)
    ros.until(lambda: len(caller.ends) == 2)
    ros.turns()
    assert len(caller.ends) == 2


def test_request_with_id_is_resent_until_answered(
    ros: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a kill: the graph shows the dead server, and the next one is not discovered yet."""
    asked: list[str] = []

    async def answer(request: Any, response: Any) -> Any:
        asked.append(request.request_id)
        if len(asked) == 1:
            # The answer to the second request may take its time.
            monkeypatch.setattr("bt_agents_ros.calls.REPEAT_S", 300.0)
            await Future(executor=ros.executor)
        return response

    server = ros.add(rclpy.create_node("server"))
    group = ReentrantCallbackGroup()
    server.create_service(
        Analyze, "somebody", answer, qos_profile=qos.SERVICE, callback_group=group
    )
    caller = Caller(ros, Analyze)
    caller.call(30.0)
    ros.until(lambda: caller.ends)
    ros.turns()
    assert caller.ends == ["answered"]
    assert len(asked) == 2
    assert len(set(asked)) == 1
    assert asked[0]


def test_unsendable_request_fails_immediately_without_delaying_others(ros: Any) -> None:
    ros.node.create_service(Analyze, "somebody", lambda _, answer: answer, qos_profile=qos.SERVICE)
    caller = Caller(ros, Analyze)
    ros.until(caller.client.service_is_ready)
    for label in ("\ud800", "Anna"):
        caller.call(30.0, label=label)
    ros.until(lambda: len(caller.ends) == 2)
    ros.turns()
    assert caller.ends[0].startswith("somebody cannot be asked: ")
    assert caller.ends[1:] == ["answered"]
