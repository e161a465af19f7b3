# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that look at the publishers of their topic."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from bt_agents_ros import qos

_REMEMBERED = 100


class TopicSubscription:
    """Subscription that matches every publisher of a topic."""

    def __init__(self, node: Node, kind: Any, topic: str, receive: Callable[..., None]) -> None:
        self._node = node
        self._subscription = self._subscribe(kind, topic, receive)

    def look(self) -> frozenset[str]:
        """Return the types of the publishers on the graph, ``package/msg/Name``."""
        return frozenset(one.topic_type for one in self._publishers())

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

    def _subscribe(self, kind: Any, topic: str, receive: Callable[..., None]) -> Any:
        return self._node.create_subscription(kind, topic, receive, qos.SENSOR)

    def _publishers(self) -> list[Any]:
        return list(self._node.get_publishers_info_by_topic(self._subscription.topic_name))


class LatchedSubscription(TopicSubscription):
    """Subscription that begins with the last message of each publisher of a topic.

    Volatile or best-effort publishers do not match a latched subscription; while the graph shows
    one at a look, a second subscription receives them. A message that arrives through both counts
    once.
    """

    def __init__(self, node: Node, kind: Any, topic: str, receive: Callable[[Any], None]) -> None:
        self._kind = kind
        self._topic = topic
        self._deliver = receive
        self._received: deque[int] = deque(maxlen=_REMEMBERED)
        self._second: TopicSubscription | None = None
        super().__init__(node, kind, topic, self._receive)

    def look(self) -> frozenset[str]:
        publishers = self._publishers()
        needed = any(
            one.qos_profile.durability is not DurabilityPolicy.TRANSIENT_LOCAL
            or one.qos_profile.reliability is not ReliabilityPolicy.RELIABLE
            for one in publishers
        )
        if needed and self._second is None:
            self._second = TopicSubscription(self._node, self._kind, self._topic, self._receive)
        elif not needed and self._second is not None:
            self._second.close()
            self._second = None
        return frozenset(one.topic_type for one in publishers)

    def close(self) -> None:
        super().close()
        if self._second is not None:
            self._second.close()

    def _subscribe(self, kind: Any, topic: str, receive: Callable[..., None]) -> Any:
        return self._node.create_subscription(kind, topic, receive, qos.FACTS)

    def _receive(self, message: Any, info: Mapping[str, Any]) -> None:
        sent_ns = int(info["source_timestamp"])
        if sent_ns not in self._received:
            self._received.append(sent_ns)
            self._deliver(message)
