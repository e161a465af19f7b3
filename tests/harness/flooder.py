# SPDX-License-Identifier: Apache-2.0
"""A process that floods a marketplace: ``flooder.py KIND``, with a kind of :data:`FLOODS`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from rclpy.node import Node

from bt_agents_interfaces.msg import Bids, Scene, SceneValue
from bt_agents_interfaces.srv import OperateMarket, RegisterHost
from bt_agents_ros import qos

MATCHED_S = 20.0
"""Until a flood gives up looking for the marketplace [s]."""

LARGE = 20_000_000
"""Characters of a text that is far too long."""


def publish(kind: Any, topic: str, messages: list[Any], node: Node) -> None:
    """Publish messages one after the other, and stay until they are acknowledged."""
    publisher = node.create_publisher(kind, topic, qos.EVENTS)
    until(publisher.get_subscription_count)
    for message in messages:
        publisher.publish(message)
    publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=MATCHED_S))


def ask(kind: Any, name: str, requests: list[Any], node: Node) -> None:
    """Send requests one after the other, and wait for the answer to each."""
    client = node.create_client(kind, name, qos_profile=qos.SERVICE)
    until(client.service_is_ready)
    for request in requests:
        answer = client.call_async(request)
        rclpy.spin_until_future_complete(node, answer, timeout_sec=MATCHED_S)
        print(answer.result().message[:80])


def until(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + MATCHED_S
    while not condition():
        if time.monotonic() > end:
            sys.exit("the marketplace is not found")
        time.sleep(0.02)


def scenes(number: int, **fields: Any) -> list[Scene]:
    """Return scenes that say nothing."""
    return [Scene(scene_id=f"flood{i}", **fields) for i in range(number)]


FLOODS: Mapping[str, Callable[[Node], None]] = {
    "labels": lambda node: publish(Scene, "scene", scenes(5, label="x" * LARGE), node),
    "scenes": lambda node: publish(Scene, "scene", scenes(3000), node),
    "values": lambda node: publish(
        Scene, "scene", scenes(20, values=[SceneValue(name="x")] * 4_000), node
    ),
    "bids": lambda node: publish(
        Bids,
        "bids",
        [Bids(epoch="e", round=i, agents=["a"] * 1000, vectors=[1.0] * 3000) for i in range(1000)],
        node,
    ),
    "large bids": lambda node: publish(
        Bids, "bids", [Bids(agents=[""] * 4_000_000) for _ in range(3)], node
    ),
    "agents": lambda node: ask(
        RegisterHost,
        "marketplace/register",
        [
            RegisterHost.Request(host="/x", agents=[f"a{i}" for i in range(400_000)])
            for _ in range(2)
        ],
        node,
    ),
    "reasons": lambda node: ask(
        OperateMarket,
        "marketplace/operate",
        [OperateMarket.Request(reason="x" * LARGE) for _ in range(5)],
        node,
    ),
}


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("flooder")
    FLOODS[sys.argv[1]](node)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
