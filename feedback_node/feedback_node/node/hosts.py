# SPDX-License-Identifier: Apache-2.0
"""Profiles on their way to the hosts that bid with them."""

from __future__ import annotations

from collections import Counter

from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from bt_agents.ros import qos
from bt_agents.ros.calls import Calls
from bt_agents_interfaces.srv import SetProfile
from feedback_node.node.messages import set_profile_name
from feedback_node.profiles import Delivery, Profiles

_LIMIT_S = 1.0


class Hosts:
    """Delivers profiles; one that its host has not answered is delivered again.

    Args:
        node: The feedback node.
        calls: Its bounded calls.
        profiles: What the hosts are to bid with.
    """

    def __init__(self, node: Node, calls: Calls, profiles: Profiles) -> None:
        self._node = node
        self._calls = calls
        self._profiles = profiles
        self._clients: dict[str, Client] = {}
        self._under_way: Counter[str] = Counter()
        self._untaken: set[str] = set()
        self._told: set[str] = set()

    def deliver(self, delivery: Delivery, answer: Future | None = None) -> None:
        """Tell a host the profile of an agent; ``answer`` gets "" or what went wrong."""

        def done(problem: str) -> None:
            self._under_way[delivery.host] -= 1
            if problem and delivery.agent not in self._told:
                self._told.add(delivery.agent)
                self._node.get_logger().warning(
                    f"{delivery.agent} revision {delivery.revision} not delivered: {problem}"
                )
            if answer is not None:
                answer.set_result(problem)

        def unanswered(problem: str) -> None:
            self._untaken.add(delivery.agent)
            done(problem)

        def answered(response: SetProfile.Response) -> None:
            self._told.discard(delivery.agent)
            done("" if response.accepted else f"{response.code}: {response.message}")

        self._under_way[delivery.host] += 1
        self._calls.call(
            self._client(delivery.host),
            SetProfile.Request(
                agent=delivery.agent, values=delivery.values, revision=delivery.revision
            ),
            deadline_s=_LIMIT_S,
            on_answer=answered,
            on_failure=unanswered,
        )

    def again(self) -> None:
        """Deliver what a host that is there has not answered; forget hosts without agents."""
        for agent in sorted(self._untaken):
            known = self._profiles.knows(agent)
            delivery = self._profiles.delivery(agent) if known else None
            if delivery is None or self._client(delivery.host).service_is_ready():
                self._untaken.discard(agent)
            if delivery is not None and agent not in self._untaken:
                self.deliver(delivery)
        self._under_way = +self._under_way
        for host in self._clients.keys() - self._profiles.hosts - self._under_way.keys():
            self._node.destroy_client(self._clients.pop(host))

    def _client(self, host: str) -> Client:
        if host not in self._clients:
            self._clients[host] = self._node.create_client(
                SetProfile, set_profile_name(host), qos_profile=qos.SERVICE
            )
        return self._clients[host]
