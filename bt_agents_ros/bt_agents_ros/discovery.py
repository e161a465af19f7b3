# SPDX-License-Identifier: Apache-2.0
"""Discovery: whether publishers and subscriptions of two nodes are matched in both directions."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from bt_agents_ros.workarounds.sender_identity import PREFIX


def is_matched(
    node: Node, publisher: Publisher[Any], subscription: Subscription[Any], partner: str
) -> bool:
    """Return whether a publisher and a subscription are matched with all that the graph shows.

    The other end of both is the process that alone publishes the topic ``partner``, perhaps more
    than once, as the graph goes on showing one that was killed.
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
    """Return the participants of endpoints that the graph shows, as callbacks are told them."""
    return frozenset(bytes(endpoint.endpoint_gid[:PREFIX]).hex() for endpoint in endpoints)
