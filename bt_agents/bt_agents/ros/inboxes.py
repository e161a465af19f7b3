# SPDX-License-Identifier: Apache-2.0
"""Topics that leaves wait for: heard only meanwhile, or, when latched, from the start."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from bt_agents.language.specs import Plain
from bt_agents.ros import qos
from bt_agents.ros.message_view import MessageView

DEPTH = 100
"""Messages that an inbox keeps; of more the oldest are dropped."""


class TopicInbox:
    """Messages of a topic from now on; nothing is subscribed to before or afterwards.

    Args:
        node: The host's node.
        topic: ROS name.
        kind: Class of the messages.
        wake: Called when a message has come.
    """

    def __init__(self, node: Node, topic: str, kind: Any, wake: Callable[[], None]) -> None:
        self._node = node
        self._messages: deque[Any] = deque(maxlen=DEPTH)
        self._wake = wake
        self._subscription: Any = node.create_subscription(kind, topic, self._take_in, qos.SENSOR)

    def take(self) -> Mapping[str, Plain] | None:
        """Return the oldest message not taken yet."""
        return MessageView(self._messages.popleft()) if self._messages else None

    def close(self) -> None:
        """Stop listening."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _take_in(self, message: Any) -> None:
        self._messages.append(message)
        self._wake()


class LatchedTopic:
    """A topic whose publisher keeps its last message; subscribed to until it is closed.

    Args:
        node: The host's node.
        topic: ROS name.
        kind: Class of the messages.
        wake: Called when a message has come that somebody waits for.
    """

    def __init__(self, node: Node, topic: str, kind: Any, wake: Callable[[], None]) -> None:
        self._node = node
        self._wake = wake
        self._last: Any = None
        self._inboxes: list[LatchedInbox] = []
        self._subscription = node.create_subscription(kind, topic, self._take_in, qos.FACTS)

    def open(self) -> LatchedInbox:
        """Return an inbox that begins with the last message, if there was one."""
        inbox = LatchedInbox(self._inboxes.remove)
        if self._last is not None:
            inbox.put(self._last)
        self._inboxes.append(inbox)
        return inbox

    def close(self) -> None:
        """Stop listening."""
        self._node.destroy_subscription(self._subscription)

    def _take_in(self, message: Any) -> None:
        self._last = message
        for inbox in self._inboxes:
            inbox.put(message)
        if self._inboxes:
            self._wake()


class LatchedInbox:
    """One leaf's view of a latched topic.

    Args:
        on_close: Called with the inbox when nobody listens any more.
    """

    def __init__(self, on_close: Callable[[LatchedInbox], None]) -> None:
        self._messages: deque[Any] = deque(maxlen=DEPTH)
        self._on_close: Callable[[LatchedInbox], None] | None = on_close

    def put(self, message: Any) -> None:
        """Take a message in."""
        self._messages.append(message)

    def take(self) -> Mapping[str, Plain] | None:
        """Return the oldest message not taken yet."""
        return MessageView(self._messages.popleft()) if self._messages else None

    def close(self) -> None:
        """Stop listening."""
        if self._on_close is not None:
            on_close, self._on_close = self._on_close, None
            on_close(self)
