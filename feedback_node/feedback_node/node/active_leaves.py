# SPDX-License-Identifier: Apache-2.0
"""Which node of a running tree is at work, as the hosts tell it."""

from __future__ import annotations

from collections.abc import Callable, Collection

from rclpy.node import Node
from rclpy.subscription import Subscription

from bt_agents_interfaces.msg import TreeStatus
from bt_agents_ros import qos


class ActiveLeaves:
    """Listens to the trees of all hosts that have introduced agents.

    Args:
        node: The feedback node.
        hear: Called back with each change of a running tree.
    """

    def __init__(self, node: Node, hear: Callable[[TreeStatus], None]) -> None:
        self._node = node
        self._hear = hear
        self._subscriptions: dict[str, Subscription[TreeStatus]] = {}

    def follow(self, hosts: Collection[str]) -> None:
        """Listen to these hosts, by their full names, and to no others."""
        for host in self._subscriptions.keys() - set(hosts):
            self._node.destroy_subscription(self._subscriptions.pop(host))
        for host in sorted(set(hosts) - self._subscriptions.keys()):
            self._subscriptions[host] = self._node.create_subscription(
                TreeStatus, f"{host}/status", self._hear, qos.EVENTS
            )
