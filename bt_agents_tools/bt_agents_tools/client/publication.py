# SPDX-License-Identifier: Apache-2.0
"""Publication of single messages to what the nodes of a running system listen to."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import ReliabilityPolicy

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind
from bt_agents_ros import qos
from bt_agents_ros.types import fill, load_type, read_field
from bt_agents_tools.client.observer import Observer

_LIMIT_S = 3.0
_SETTLE_S = 0.5
"""Time before and after a message for listeners that confirm nothing: until they know the
publisher, and until they have taken the message, which is gone with its publisher [s]."""

_OWN_PACKAGES = ("action_msgs", "bt_agents_interfaces", "rcl_interfaces", "rosgraph_msgs")


def heard_topics(observer: Observer, nodes: Iterable[str]) -> dict[str, str]:
    """Return the topics that some nodes subscribe to now, with their types.

    Names are relative to the namespace of the system. Its own messages are left out.
    """
    graph = observer.node
    known = {
        f"{namespace.rstrip('/')}/{name}": (name, namespace)
        for name, namespace in graph.get_node_names_and_namespaces()
    }
    prefix = observer.namespace.rstrip("/") + "/"
    return {
        topic.removeprefix(prefix): types[0]
        for node in nodes
        if node in known
        for topic, types in graph.get_subscriber_names_and_types_by_node(*known[node])
        if types[0].partition("/")[0] not in _OWN_PACKAGES and "/_" not in topic
    }


def typed_message(type_name: str, texts: Sequence[str]) -> Any:
    """Return a message of typed texts: ``name=value`` each, or the value of its only field.

    Raises:
        Refused: ``NO_ASSIGNMENT``, or as :func:`load_type`, :func:`read_field` and :func:`fill`.
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
                "NO_ASSIGNMENT", f"'{text}' for a {type_name}, expected {example}; it has {names}"
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


def publish(observer: Observer, topic: str, message: Any) -> bool:
    """Publish a message once all who listen are connected; return whether it has reached them.

    Trees listen by best effort, so that every publisher reaches them: they cannot say what they
    got.
    """
    # Latched, so that every kind of subscription matches.
    publisher = observer.node.create_publisher(type(message), topic, qos.FACT)

    def connected() -> bool:
        listening = observer.node.count_subscribers(topic)
        return bool(0 < listening <= publisher.get_subscription_count())

    if not observer.spin_until(connected, _LIMIT_S):
        return False
    listeners = observer.node.get_subscriptions_info_by_topic(topic)
    lossy = any(one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for one in listeners)
    settle_s = _SETTLE_S if lossy else 0.0
    observer.spin_until(lambda: False, settle_s)
    publisher.publish(message)
    observer.spin_until(lambda: False, settle_s)
    return bool(publisher.wait_for_all_acked(Duration(seconds=_LIMIT_S)))
