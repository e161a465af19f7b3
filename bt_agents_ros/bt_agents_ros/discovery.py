# SPDX-License-Identifier: Apache-2.0
"""Whether two nodes hear each other already, so that no message between them is lost."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

_PROCESS = 12
"""Leading bytes of an endpoint's id that are those of its process."""


def is_matched(node: Node, said: Publisher[Any], heard: Subscription[Any], partner: str) -> bool:
    """Return whether a publisher and a subscription are matched with all that the graph shows.

    Args:
        node: Whose both are.
        said: What the partner listens to.
        heard: What the partner says.
        partner: A topic that only the partner publishes; there may be several of them, as the
            graph goes on showing one that was killed.
    """
    listeners = node.get_subscriptions_info_by_topic(said.topic_name)
    speakers = node.get_publishers_info_by_topic(heard.topic_name)
    partners = _processes(node.get_publishers_info_by_topic(partner))
    return (
        partners <= _processes(listeners)
        and partners <= _processes(speakers)
        and said.get_subscription_count() >= len(listeners)
        and heard.get_publisher_count() >= len(speakers)
    )


def _processes(endpoints: list[Any]) -> set[bytes]:
    return {bytes(endpoint.endpoint_gid[:_PROCESS]) for endpoint in endpoints}
