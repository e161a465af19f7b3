# SPDX-License-Identifier: Apache-2.0
"""Discovery: types of names on the graph, and whether two nodes match in both directions."""

from __future__ import annotations

from typing import Any

from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from bt_agents_core.field_types import BindingKind
from bt_agents_ros.workarounds.departed_clients import PREFIX

_UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""Name that the middleware gives to a node of which it knows only an endpoint so far."""


def is_matched(
    node: Node, publisher: Publisher[Any], subscription: Subscription[Any], partner: str
) -> bool:
    """Return whether a publisher and a subscription match all endpoints that the graph shows.

    The other end of both is the only process that publishes the topic ``partner``. The graph may
    list it more than once, because it still shows killed processes for a while.
    """
    subscriptions = node.get_subscriptions_info_by_topic(publisher.topic_name)
    publishers = node.get_publishers_info_by_topic(subscription.topic_name)
    partners = participants(node.get_publishers_info_by_topic(partner))
    return (
        partners <= participants(subscriptions)
        and partners <= participants(publishers)
        and publisher.get_subscription_count() >= len(subscriptions)
        and subscription.get_publisher_count() >= len(publishers)
    )


def participants(endpoints: list[Any]) -> frozenset[str]:
    """Return the participants of endpoints on the graph."""
    return frozenset(bytes(endpoint.endpoint_gid[:PREFIX]).hex() for endpoint in endpoints)


def node_of(endpoint: Any) -> str:
    """Return the full name of the node of an endpoint; empty while the graph does not know it."""
    if endpoint.node_name == _UNKNOWN:
        return ""
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def types_on_graph(node: Node, kind: BindingKind, name: str) -> frozenset[str]:
    """Return the types of the servers of an action or service, or of a topic's publishers."""
    if kind is BindingKind.SERVICE:
        name = node.resolve_service_name(name)
        others = node.get_node_names_and_namespaces()
        served = (dict(node.get_service_names_and_types_by_node(*other)) for other in others)
        return frozenset(one for services in served for one in services.get(name, ()))
    if kind is BindingKind.ACTION:
        # rclpy does not remap actions.
        name = expand_topic_name(name, node.get_name(), node.get_namespace())
        name += "/_action/feedback"
    published = node.get_publishers_info_by_topic(name)
    return frozenset(one.topic_type.removesuffix("_FeedbackMessage") for one in published)
