# SPDX-License-Identifier: Apache-2.0
"""Publication of single messages on topics that the nodes of a running system listen to."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_ros import qos
from bt_agents_ros.system_topics import TOPICS
from bt_agents_ros.types import fill, load_type, read_field
from bt_agents_tools.client.observer import Observer

_LIMIT_S = 3.0
_SETTLE_S = 0.5
"""Time before and after a message for listeners that confirm nothing [s].

Before it they discover the publisher, after it they take the message, which is lost with its
publisher."""

_AT_ONCE = Duration(nanoseconds=1)

_ROS_PACKAGES = ("action_msgs", "rcl_interfaces", "rosgraph_msgs")
_OWN_PACKAGE = "bt_agents_interfaces"


def heard_topics(graph: Node, nodes: Iterable[str]) -> dict[str, str]:
    """Return the topics that some nodes subscribe to now, with their types.

    Names are relative to the namespace of the observing node ``graph``. Topics of the system are
    left out.
    """
    known = {
        f"{namespace.rstrip('/')}/{name}": (name, namespace)
        for name, namespace in graph.get_node_names_and_namespaces()
    }
    prefix = graph.get_namespace().rstrip("/") + "/"
    heard = {
        topic.removeprefix(prefix): types[0]
        for node in nodes
        if node in known
        for topic, types in graph.get_subscriber_names_and_types_by_node(*known[node])
        if "/_" not in topic
    }
    return {topic: kind for topic, kind in heard.items() if not _is_of_the_system(topic, kind)}


def _is_of_the_system(topic: str, kind: str) -> bool:
    """Return whether a topic serves ROS or the system; a tracker may use our types, too."""
    package = kind.partition("/")[0]
    if package == _OWN_PACKAGE:
        return any(one.is_called(topic) for one in TOPICS)
    return package in _ROS_PACKAGES


def heard_message(heard: Mapping[str, str], topic: str, texts: Sequence[str]) -> Any:
    """Return a message for a topic that has listeners; see :func:`typed_message`.

    Raises:
        Refused: ``NOBODY_LISTENS``, or as in :func:`typed_message`.
    """
    if topic not in heard:
        hint = did_you_mean(topic, sorted(heard)) or "a tree listens while its wait_for runs"
        raise Refused(RefusalCode.NOBODY_LISTENS, f"nobody listens to '{topic}' now; {hint}")
    return typed_message(heard[topic], texts)


def not_taken(topic: str) -> Refused:
    """Return the refusal of a message that has reached no listener."""
    return Refused(
        RefusalCode.NOT_TAKEN, f"nobody has taken the message on {topic}; the tree has gone on"
    )


def typed_message(type_name: str, texts: Sequence[str]) -> Any:
    """Return a message from typed texts: ``name=value`` each, or the value of its only field.

    Raises:
        Refused: ``NO_ASSIGNMENT``, or as in :func:`load_type`, :func:`read_field`, :func:`fill`.
    """
    message = load_type(type_name, BindingKind.TOPIC)()
    names = list(message.get_fields_and_field_types())
    for text in texts:
        path, equals, value = text.partition("=")
        if len(names) == len(texts) == 1 and path.partition(".")[0] != names[0]:
            path, equals, value = names[0], "=", text
        if not equals:
            example = f"'{names[0]}=…'" if names else "no value, as it has no fields"
            raise Refused(
                RefusalCode.NO_ASSIGNMENT,
                f"'{text}' for a {type_name}, expected {example}; it has {names}",
            )
        plain = _plain(value, read_field(message, path))
        for part in reversed(path.split(".")):
            plain = {part: plain}
        fill(message, plain)
    return message


def _plain(text: str, example: object) -> Any:
    if isinstance(example, str):
        return text
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


class PendingPublication:
    """Message that is published once all listeners are connected.

    Trees listen by best effort to match every publisher, so they cannot confirm a message. The
    publisher keeps the message for late listeners to match every kind of subscription, so it
    exists for this message only.

    Args:
        node: Node that publishes it.
        topic: Its topic.
        message: The message.
        now_s: Current time on the steady clock [s].
    """

    def __init__(self, node: Node, topic: str, message: Any, now_s: float) -> None:
        self._node = node
        self._topic = topic
        self._message = message
        self._publisher = node.create_publisher(type(message), topic, qos.FACT)
        self._limit_s = now_s + _LIMIT_S
        self._settle_s = 0.0
        self._due_s: float | None = None
        self._sent = False

    def poll(self, now_s: float) -> bool | None:
        """Continue; return whether the message has reached all listeners, None while unknown."""
        if self._due_s is None:
            listening = self._node.count_subscribers(self._topic)
            if not 0 < listening <= self._publisher.get_subscription_count():
                return False if now_s > self._limit_s else None
            listeners = self._node.get_subscriptions_info_by_topic(self._topic)
            if any(
                one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for one in listeners
            ):
                self._settle_s = _SETTLE_S
            self._due_s = now_s + self._settle_s
        if now_s < self._due_s:
            return None
        if not self._sent:
            self._sent = True
            self._publisher.publish(self._message)
            self._due_s = now_s + self._settle_s
            self._limit_s = self._due_s + _LIMIT_S
            return None
        if self._publisher.wait_for_all_acked(_AT_ONCE):
            return True
        return False if now_s > self._limit_s else None

    def is_settled(self, now_s: float) -> bool:
        """Return whether it is sent, and only confirmations of reliable listeners are open."""
        return self._sent and self._due_s is not None and now_s >= self._due_s

    def confirmed(self) -> bool:
        """Wait for confirmations of reliable listeners; return whether all came in time."""
        return bool(self._publisher.wait_for_all_acked(Duration(seconds=_LIMIT_S)))

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)


def publish(observer: Observer, topic: str, message: Any) -> bool:
    """Publish a message once all listeners are connected; return whether it has reached them.

    Reactions of reliable listeners are received only after that.
    """
    reached: bool | None = None

    def ended() -> bool:
        nonlocal reached
        reached = pending.poll(time.monotonic())
        return reached is not None or pending.is_settled(time.monotonic())

    with closing(PendingPublication(observer.node, topic, message, time.monotonic())) as pending:
        observer.spin_until(ended, 3.0 * _LIMIT_S)
        if reached is None and pending.is_settled(time.monotonic()):
            reached = pending.confirmed()
    return bool(reached)
