# SPDX-License-Identifier: Apache-2.0
"""The nodes of a test in this process, and an executor that spins them until a condition holds."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from bt_agents_ros.workarounds.cached_executor import CachedExecutor


class Ros:
    """The nodes of one test, and the executor that spins them."""

    def __init__(self) -> None:
        self.executor = CachedExecutor()
        self.nodes: list[Node] = []
        self.node = self.add(rclpy.create_node("probe"))

    def add(self, node: Any) -> Any:
        """Spin a node until the end of the test; return it."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def remove(self, node: Any) -> None:
        """Remove a node, as if its process had ended."""
        self.nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def until(self, condition: Callable[[], Any], limit_s: float = 30.0) -> None:
        """Spin until the condition holds; fail the test at the time limit."""
        end = time.monotonic() + limit_s
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f"not within {limit_s} s: {condition}")
            self.executor.spin_once(timeout_sec=0.05)

    def turns(self, count: int = 20) -> None:
        """Spin a few times, to check that something does not happen."""
        for _ in range(count):
            self.executor.spin_once(timeout_sec=0.01)

    def call(self, client: Any, request: Any, limit_s: float = 30.0) -> Any:
        """Call a service and return its response."""
        self.until(client.service_is_ready, limit_s)
        return self.result(client.call_async(request), limit_s)

    def result(self, future: Any, limit_s: float = 30.0) -> Any:
        """Spin until a future is done; return its result."""
        self.until(future.done, limit_s)
        return future.result()

    def ask(self, kind: Any, service: str, **fields: Any) -> Any:
        """Call a service by its name; return its response."""
        return self.call(self.node.create_client(kind, service), kind.Request(**fields))

    def collect(self, kind: Any, topic: str, qos: Any) -> list[Any]:
        """Return a list that grows with every message of a topic."""
        received: list[Any] = []
        self.node.create_subscription(kind, topic, received.append, qos)
        return received

    def close(self) -> None:
        """End pending work, as the runner does, and destroy all nodes."""
        try:
            for node in self.nodes:
                if hasattr(node, "request_stop"):
                    node.request_stop()
                    end = time.monotonic() + 0.5
                    while not node.stopped() and time.monotonic() < end:
                        self.executor.spin_once(timeout_sec=0.05)
        finally:
            for node in list(self.nodes):
                self.remove(node)
            self.executor.shutdown()


@contextmanager
def fresh_graph() -> Iterator[Ros]:
    """Create a ROS context for one test, and shut it down afterwards."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        graph = Ros()
        try:
            yield graph
        finally:
            graph.close()
    finally:
        rclpy.try_shutdown()
        # Reference cycles keep nodes alive, and nodes of earlier tests would answer each other.
        gc.collect()
