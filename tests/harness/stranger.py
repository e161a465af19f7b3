# SPDX-License-Identifier: Apache-2.0
"""A node with its own participant in the process of a test, like one in another process."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from bt_agents_ros import qos
from bt_agents_ros.workarounds.cached_executor import CachedExecutor
from graph import Ros

_QUIET_S = 0.05


class Stranger:
    """A node with its own participant; a participant can have only one type under each name.

    Args:
        ros: The nodes of the test.
        name: Name of the node.
    """

    def __init__(self, ros: Ros, name: str = "stranger") -> None:
        self.ros = ros
        self._name = name
        self.context = Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node(name, context=self.context, enable_rosout=False)
        self.executor = CachedExecutor(context=self.context)
        self.executor.add_node(self.node)
        ros.until(self._is_known)

    def publisher(self, kind: Any, topic: str) -> Any:
        """Return a publisher that has a subscription."""
        publisher = self.node.create_publisher(kind, topic, qos.EVENTS)
        self.ros.until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service and return its response."""
        client = self.node.create_client(kind, name, qos_profile=qos.SERVICE)
        self.ros.until(client.service_is_ready)
        return self.answer(client.call_async(request))

    def answer(self, future: Any) -> Any:
        """Return an answer that arrives."""
        self.until(future.done)
        return future.result()

    def until(self, condition: Callable[[], Any]) -> None:
        """Spin this node, too, until the condition holds."""

        def holds() -> Any:
            self.executor.spin_once(0)
            return condition()

        self.ros.until(holds)

    def close(self) -> None:
        """End the participant, and wait until that of the test has noticed.

        Fast DDS hangs for ever if a participant ends while it discovers the end of another one;
        see :mod:`bt_agents_ros.workarounds.bounded_end`.
        """
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()
        # Reference cycles keep the participant alive.
        gc.collect()
        self.ros.until(lambda: not self._is_known())
        time.sleep(_QUIET_S)

    def _is_known(self) -> bool:
        return self._name in self.ros.node.get_node_names()
