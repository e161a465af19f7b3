# SPDX-License-Identifier: Apache-2.0
"""Delivers profiles to the hosts that bid with them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from bt_agents_interfaces.srv import SetProfile
from bt_agents_ros import qos
from bt_agents_ros.calls import Calls
from feedback_node.learning.profiles import Delivery, Profiles
from feedback_node.node.messages import set_profile_name

_LIMIT_S = 1.0
_MOST_UNDER_WAY = 200


class ProfileDeliveries:
    """Delivers profiles; repeats a delivery that its host has not answered.

    Args:
        node: The feedback node.
        calls: Its calls.
        profiles: The profiles to deliver.
        on_problem: Called after a host has not taken the profile of an agent for everybody.
    """

    def __init__(
        self, node: Node, calls: Calls, profiles: Profiles, on_problem: Callable[[], None]
    ) -> None:
        self._node = node
        self._on_problem = on_problem
        self._calls = calls
        self._profiles = profiles
        self._clients: dict[str, Client] = {}
        self._under_way: Counter[str] = Counter()
        self._waiting: dict[str, dict[tuple[str, str, str], Delivery]] = {}
        self._unanswered: dict[tuple[str, str, str], Delivery] = {}
        self._reported: set[str] = set()

    def is_there(self, host: str) -> bool:
        """Return whether a host accepts profiles."""
        return bool(self._client(host).service_is_ready())

    def deliver(self, delivery: Delivery, answer: Future | None = None) -> None:
        """Send a profile to its host; ``answer`` gets the problem in words, empty for none."""
        if answer is None and self._under_way[delivery.host] >= _MOST_UNDER_WAY:
            self._waiting.setdefault(delivery.host, {})[_key(delivery)] = delivery
            return

        def done(problem: str) -> None:
            self._under_way[delivery.host] -= 1
            if problem and delivery.agent not in self._reported:
                self._reported.add(delivery.agent)
                self._node.get_logger().warning(f"{_text(delivery)} not delivered: {problem}")
            if problem and not delivery.layer:
                self._profiles.not_delivered(delivery.agent)
                self._on_problem()
            if answer is not None:
                answer.set_result(problem)
            self._deliver_next(delivery.host)

        def unanswered(problem: str) -> None:
            self._unanswered[_key(delivery)] = delivery
            done(problem)

        def answered(response: SetProfile.Response) -> None:
            self._reported.discard(delivery.agent)
            done("" if response.accepted else f"{response.code}: {response.message}")
            if not delivery.agent:
                for layer in self._profiles.layers_at(delivery.host):
                    self.deliver(layer)

        self._under_way[delivery.host] += 1
        self._calls.call(
            self._client(delivery.host),
            SetProfile.Request(
                agent=delivery.agent,
                layer=delivery.layer,
                remove=delivery.remove,
                values=delivery.values,
                revision=delivery.revision,
            ),
            deadline_s=_LIMIT_S,
            on_answer=answered,
            on_failure=unanswered,
        )

    def retry(self) -> None:
        """Resend what available hosts have not answered; drop the clients of unknown hosts."""
        for key, waiting in sorted(self._unanswered.items()):
            delivery = self._refreshed(waiting)
            if delivery is None or self._client(delivery.host).service_is_ready():
                del self._unanswered[key]
                if delivery is not None:
                    self.deliver(delivery)
        self._under_way = +self._under_way
        for host in self._clients.keys() - self._profiles.hosts - self._under_way.keys():
            self._node.destroy_client(self._clients.pop(host))

    def _deliver_next(self, host: str) -> None:
        waiting = self._waiting.get(host, {})
        while waiting:
            delivery = self._refreshed(waiting.pop(next(iter(waiting))))
            if delivery is not None:
                self.deliver(delivery)
                return
        self._waiting.pop(host, None)

    def _refreshed(self, delivery: Delivery) -> Delivery | None:
        """Return a delivery with the current profile; None if no host needs it any more."""
        if not delivery.agent:
            return delivery if delivery.host in self._profiles.hosts else None
        if not self._profiles.knows(delivery.agent):
            return None
        return self._profiles.delivery(delivery.agent, delivery.layer)

    def _client(self, host: str) -> Client:
        if host not in self._clients:
            self._clients[host] = self._node.create_client(
                SetProfile, set_profile_name(host), qos_profile=qos.SERVICE
            )
        return self._clients[host]


def _key(delivery: Delivery) -> tuple[str, str, str]:
    return delivery.host, delivery.agent, delivery.layer


def _text(delivery: Delivery) -> str:
    if not delivery.agent:
        return f"that {delivery.host} is to forget its layers"
    what = f"for {delivery.layer} " if delivery.layer else ""
    return f"{delivery.agent} {what}" + (
        "forgotten," if delivery.remove else f"revision {delivery.revision}"
    )
