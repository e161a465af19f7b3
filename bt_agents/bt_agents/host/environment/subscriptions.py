# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of trees: topics that leaves wait for, and the heartbeats of servers."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any

from rclpy.node import Node

from bt_agents_core.field_types import Plain
from bt_agents_language.model.specs import HeartbeatSpec
from bt_agents_ros import qos
from bt_agents_ros.message_view import MessageView
from bt_agents_ros.types import load_type

DEPTH = 100
"""Most messages of an inbox; then the oldest are dropped."""


class TopicInbox:
    """Messages of a topic for one leaf.

    Args:
        on_close: Called with the inbox when it is closed.
    """

    def __init__(self, on_close: Callable[[TopicInbox], None]) -> None:
        self._messages: deque[Any] = deque(maxlen=DEPTH)
        self._on_close: Callable[[TopicInbox], None] | None = on_close

    def put(self, message: Any) -> None:
        """Append a message."""
        self._messages.append(message)

    def take(self) -> Mapping[str, Plain] | None:
        return MessageView(self._messages.popleft()) if self._messages else None

    def close(self) -> None:
        if self._on_close is not None:
            on_close, self._on_close = self._on_close, None
            on_close(self)


def open_inbox(node: Node, topic: str, kind: Any, wake: Callable[[], None]) -> TopicInbox:
    """Return an inbox of a topic, which is subscribed to until the inbox is closed.

    A message that has come wakes the leaf.
    """

    def receive(message: Any) -> None:
        inbox.put(message)
        wake()

    subscription = node.create_subscription(kind, topic, receive, qos.SENSOR)
    inbox = TopicInbox(lambda _inbox: node.destroy_subscription(subscription))
    return inbox


class LatchedTopic:
    """A topic with a transient-local publisher; subscribed to until it is closed.

    A message that has come while an inbox is open wakes the leaf.
    """

    def __init__(self, node: Node, topic: str, kind: Any, wake: Callable[[], None]) -> None:
        self._node = node
        self._wake = wake
        self._last: Any = None
        self._inboxes: list[TopicInbox] = []
        self._subscription = node.create_subscription(kind, topic, self._receive, qos.FACTS)

    def open(self) -> TopicInbox:
        """Return an inbox that begins with the last message, if there was one."""
        inbox = TopicInbox(self._inboxes.remove)
        if self._last is not None:
            inbox.put(self._last)
        self._inboxes.append(inbox)
        return inbox

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

    def _receive(self, message: Any) -> None:
        self._last = message
        for inbox in self._inboxes:
            inbox.put(message)
        if self._inboxes:
            self._wake()


class Heartbeats:
    """Subscriptions to the heartbeats of servers."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._last: dict[tuple[str, str], float] = {}
        self._subscriptions: dict[tuple[str, str], Any] = {}

    def subscribe(self, spec: HeartbeatSpec) -> Callable[[], float]:
        """Return a function for the time of the last one [s], minus infinity for never.

        Raises:
            Refused: ``UNKNOWN_TYPE``.
        """
        key = (spec.topic, spec.type)
        if key not in self._subscriptions:
            kind = load_type(spec.type)

            def receive(_message: object) -> None:
                self._last[key] = time.monotonic()

            # Its content does not matter, so it is not even decoded.
            self._subscriptions[key] = self._node.create_subscription(
                kind, spec.topic, receive, qos.SENSOR, raw=True
            )
        return lambda: self._last.get(key, -math.inf)

    def retain(self, wanted: Collection[tuple[str, str]]) -> None:
        """Unsubscribe from all others than these topics, each with its type."""
        for key in self._subscriptions.keys() - set(wanted):
            self._node.destroy_subscription(self._subscriptions.pop(key))
            self._last.pop(key, None)
