# SPDX-License-Identifier: Apache-2.0
"""Clients that leave before their answers are sent: no other client waits for them.

The middleware waits only sometimes; here a clock makes every answer slow.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionServer, GoalResponse
from rclpy.node import Node

from bt_agents_interfaces.action import Say
from bt_agents_ros.qos import SERVICE
from graph import Ros
from stranger import Stranger

ASKED = "/asked"
REQUESTS = 30


class Leaver(Stranger):
    """A separate participant, with clients that come and go."""

    def client(self, kind: Any = GetParameters, name: str = ASKED) -> Any:
        """Return a client matched with the service in both directions."""
        client = self.node.create_client(kind, name, qos_profile=SERVICE)
        self.ros.until(client.service_is_ready)
        self.ros.until(lambda: self.readers(name))
        return client

    def leave(self, client: Any) -> None:
        """Destroy a client; return once the graph no longer shows it."""
        name = client.service_name
        before = len(self.readers(name))
        self.node.destroy_client(client)
        end = time.monotonic() + 20.0
        while len(self.readers(name)) == before:
            assert time.monotonic() < end, "the client is still shown"
            self.executor.spin_once(0.01)

    def readers(self, name: str) -> list[Any]:
        """Return the readers of a service's answers, as seen by the answering node."""
        topic = f"rr{name}Reply"
        return list(self.ros.node.get_subscriptions_info_by_topic(topic, no_mangle=True))


@pytest.fixture
def stranger(ros: Ros) -> Iterator[Leaver]:
    made = Leaver(ros)
    looks = count()
    ros.executor._departed.clock = lambda: 0.06 * next(looks)
    yield made
    made.close()


def say_server(node: Node, decide: Callable[[Any], GoalResponse]) -> ActionServer:
    return ActionServer(
        node,
        Say,
        "say",
        lambda _goal: Say.Result(),
        goal_callback=decide,
        goal_service_qos_profile=SERVICE,
    )


@pytest.mark.filterwarnings("ignore:failed to send response:RuntimeWarning")
def test_service_skips_remaining_requests_of_departed_client(ros: Ros, stranger: Leaver) -> None:
    requests: list[Any] = []
    answers: list[Any] = []

    def answer(request: Any, response: Any) -> Any:
        if not requests:
            stranger.leave(client)
        requests.append(request)
        return response

    def send_counted(*answer: Any) -> None:
        answers.append(answer)
        send(*answer)

    service = ros.node.create_service(GetParameters, ASKED, answer, qos_profile=SERVICE)
    send, service.send_response = service.send_response, send_counted
    client = stranger.client()
    for _ in range(REQUESTS):
        client.call_async(GetParameters.Request())
    ros.until(lambda: len(requests) == REQUESTS)

    assert len(answers) == 1

    present = stranger.client()
    for _ in range(3):
        assert stranger.answer(present.call_async(GetParameters.Request())) is not None

    assert len(answers) == 4


def test_second_node_of_one_name_hides_no_client(ros: Ros) -> None:
    # The graph names the older of two participants first.
    other = Stranger(ros, "twin")
    node = other.node
    looks = count()
    other.executor._departed.clock = lambda: 0.06 * next(looks)
    server = say_server(node, lambda _goal: GoalResponse.REJECT)
    twin = Node("twin", context=ros.node.context, enable_rosout=False)
    kind = Say.Impl.SendGoalService
    client = ros.node.create_client(kind, "say/_action/send_goal", qos_profile=SERVICE)

    try:
        other.until(lambda: node.get_node_names().count("twin") == 2)
        other.until(client.service_is_ready)
        other.until(
            lambda: node.get_subscriptions_info_by_topic("rr/say/_action/send_goalReply", True)
        )
        for _ in range(3):
            other.until(client.call_async(kind.Request()).done)
    finally:
        server.destroy()
        twin.destroy_node()
        other.close()


@pytest.mark.filterwarnings("ignore:failed to send response:RuntimeWarning")
def test_goals_of_departed_client_are_not_started(ros: Ros, stranger: Leaver) -> None:
    asked: list[Any] = []

    def decide(goal: Any) -> GoalResponse:
        if not asked:
            stranger.leave(client)
        asked.append(goal)
        return GoalResponse.REJECT

    server = say_server(ros.node, decide)
    kind = Say.Impl.SendGoalService
    client = stranger.client(kind, "/say/_action/send_goal")
    for number in range(REQUESTS):
        request = kind.Request()
        request.goal_id.uuid = list(number.to_bytes(16, "big"))
        client.call_async(request)
    ros.until(lambda: asked)
    other = stranger.client(kind, "/say/_action/send_goal")
    stranger.answer(other.call_async(kind.Request()))

    assert len(asked) == 2, "the first one, and the next client's"
    server.destroy()
