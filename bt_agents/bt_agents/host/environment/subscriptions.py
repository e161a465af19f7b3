# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of trees: topics that leaves wait for, and heartbeats of servers."""

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
from bt_agents_ros.topic_subscription import LatchedSubscription
from bt_agents_ros.types import MessageView, load_type
from bt_agents_ros.workarounds.cached_wait_set import PolledGroup

DEPTH = 100
"""Most messages of an inbox; beyond it, the oldest are dropped."""


class TopicInbox:
    """Messages of a topic for one leaf.

    Args:
        on_close: Called with the inbox when it is closed.
        problem: Returns the problem of the topic; empty for none.
    """

    def __init__(self, on_close: Callable[[TopicInbox], None], problem: Callable[[], str]) -> None:
        self._messages: deque[Any] = deque(maxlen=DEPTH)
        self._problem = problem
        self._on_close: Callable[[TopicInbox], None] | None = on_close

    @property
    def problem(self) -> str:
        return self._problem()

    def put(self, message: Any) -> None:
        """Append a message."""
        self._messages.append(message)

    def take(self) -> Mapping[str, Plain] | None:
        return MessageView(self._messages.popleft()) if self._messages else None

    def close(self) -> None:
        if self._on_close is not None:
            on_close, self._on_close = self._on_close, None
            on_close(self)


def open_inbox(
    node: Node, topic: str, kind: Any, wake: Callable[[], None], problem: Callable[[], str]
) -> TopicInbox:
    """Return an inbox with a subscription to a topic, which closing the inbox ends.

    Each message wakes the leaf.
    """

    def receive(message: Any) -> None:
        inbox.put(message)
        wake()

    subscription = node.create_subscription(kind, topic, receive, qos.SENSOR)
    inbox = TopicInbox(lambda _inbox: node.destroy_subscription(subscription), problem)
    return inbox


class LatchedTopic:
    """Topic whose last message counts, too, until it is closed.

    A message that arrives while an inbox is open wakes the leaf.
    """

    def __init__(self, node: Node, topic: str, kind: Any, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._last: Any = None
        self._inboxes: list[TopicInbox] = []
        self._subscription = LatchedSubscription(node, kind, topic, self._receive)
        self.look = self._subscription.look
        self.close = self._subscription.close

    @property
    def keeps_message(self) -> bool:
        """True if a message has arrived, which counts for every leaf that waits later."""
        return self._last is not None

    def open(self, problem: Callable[[], str]) -> TopicInbox:
        """Return an inbox that begins with the last message, if any."""
        self.look()
        inbox = TopicInbox(self._inboxes.remove, problem)
        if self._last is not None:
            inbox.put(self._last)
        self._inboxes.append(inbox)
        return inbox

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
        self._group = PolledGroup()
        self._last: dict[tuple[str, str], float] = {}
        self._subscriptions: dict[tuple[str, str], Any] = {}

    def subscribe(self, spec: HeartbeatSpec) -> Callable[[], float]:
        """Return a function for the time of the last heartbeat [s], minus infinity for none.

        Raises:
            Refused: ``UNKNOWN_TYPE``.
        """
        key = (spec.topic, spec.type)
        if key not in self._subscriptions:
            kind = load_type(spec.type)

            def receive(_message: object) -> None:
                self._last[key] = time.monotonic()

            # The content does not matter, so it is not decoded.
            self._subscriptions[key] = self._node.create_subscription(
                kind, spec.topic, receive, qos.SENSOR, raw=True, callback_group=self._group
            )
        return lambda: self._last.get(key, -math.inf)

    def retain(self, wanted: Collection[tuple[str, str]]) -> None:
        """Unsubscribe from all topics except these, each with its type."""
        for key in self._subscriptions.keys() - set(wanted):
            self._node.destroy_subscription(self._subscriptions.pop(key))
            self._last.pop(key, None)
