# SPDX-License-Identifier: Apache-2.0
"""The behaviours of the example; they need py_trees_ros."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
import rclpy
from py_trees.common import Status
from rclpy.node import Node
from std_msgs.msg import Bool, String

pytest.importorskip("py_trees_ros")

from their_nodes import Door, Listen

LIMIT_S = 20.0


@pytest.fixture
def node() -> Iterator[Node]:
    rclpy.init()
    made = rclpy.create_node("example")
    yield made
    made.destroy_node()
    rclpy.shutdown()


def until(node: Node, condition: Callable[[], bool]) -> None:
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end
        rclpy.spin_once(node, timeout_sec=0.05)


def test_open_door_ends_waiting(node: Node) -> None:
    door = Door("door", True)
    door.setup(node=node)
    publisher = node.create_publisher(Bool, "door", 1)

    def opens(is_open: bool) -> bool:
        publisher.publish(Bool(data=is_open))
        door.tick_once()
        return door.status is Status.SUCCESS

    until(node, lambda: publisher.get_subscription_count() > 0)
    for _ in range(5):
        assert not opens(False)
        rclpy.spin_once(node, timeout_sec=0.05)
    until(node, lambda: opens(True))


def test_listening_ends_with_words(node: Node) -> None:
    listen = Listen("listen")
    listen.setup(node=node)
    publisher = node.create_publisher(String, "words", 10)

    def says() -> bool:
        publisher.publish(String(data="hello"))
        listen.tick_once()
        return listen.status is Status.SUCCESS

    until(node, says)
