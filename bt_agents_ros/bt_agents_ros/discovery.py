# SPDX-License-Identifier: Apache-2.0
"""Discovery: whether publishers and subscriptions of two nodes are matched in both directions."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

_GUID_PREFIX = 12
"""Leading bytes of an endpoint's GID that are the same for all of its process."""


def is_matched(
    node: Node, publisher: Publisher[Any], subscription: Subscription[Any], partner: str
) -> bool:
    """Return whether a publisher and a subscription are matched with all that the graph shows.

    The other end of both is the process that alone publishes the topic ``partner``, perhaps more
    than once, as the graph goes on showing one that was killed.
    """
    subscriptions = node.get_subscriptions_info_by_topic(publisher.topic_name)
    publishers = node.get_publishers_info_by_topic(subscription.topic_name)
    partners = _processes(node.get_publishers_info_by_topic(partner))
    return (
        partners <= _processes(subscriptions)
        and partners <= _processes(publishers)
        and publisher.get_subscription_count() >= len(subscriptions)
        and subscription.get_publisher_count() >= len(publishers)
    )


def _processes(endpoints: list[Any]) -> set[bytes]:
    return {bytes(endpoint.endpoint_gid[:_GUID_PREFIX]) for endpoint in endpoints}
