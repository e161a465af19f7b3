# SPDX-License-Identifier: Apache-2.0
"""Whether those who count are matched as readers of a publisher, so that nothing is lost."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

_PARTICIPANT = 12
"""Leading bytes of an endpoint's id that are those of its process."""


def is_heard(node: Node, publisher: Publisher[Any], by: str) -> bool:
    """Return whether everybody who publishes a topic is matched as a reader of a publisher.

    Args:
        node: Whose publisher it is.
        publisher: What is to be heard.
        by: The other topic, which those publish that count.
    """
    readers = node.get_subscriptions_info_by_topic(publisher.topic_name)
    speakers = {_process(endpoint) for endpoint in node.get_publishers_info_by_topic(by)}
    return speakers <= {
        _process(endpoint) for endpoint in readers
    } and publisher.get_subscription_count() >= len(readers)


def _process(endpoint: Any) -> bytes:
    return bytes(endpoint.endpoint_gid[:_PARTICIPANT])
