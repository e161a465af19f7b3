# SPDX-License-Identifier: Apache-2.0
"""A bare node with the endpoints and timers in a file: ``bare_idle.py LAYOUT NODE``."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from bare import EVENTS, spin
from bt_agents_ros.types import load_type


def qos(policies: list[int]) -> QoSProfile:
    """Return a profile with these policies of reliability and durability."""
    return QoSProfile(depth=EVENTS.depth, reliability=policies[0], durability=policies[1])


def make(name: str, layout: dict[str, list[Any]]) -> Node:
    """Return a node that looks from outside like a node of the layout."""
    node = rclpy.create_node(name)
    for topic, type_name, policies in layout["subscriptions"]:
        node.create_subscription(load_type(type_name), topic, lambda _: None, qos(policies))
    for service, type_name in layout["services"]:
        node.create_service(
            load_type(type_name), service, lambda _, response: response, qos_profile=EVENTS
        )
    for service, type_name in layout["clients"]:
        node.create_client(load_type(type_name), service, qos_profile=EVENTS)
    for action, type_name in layout["action_servers"]:
        kind = load_type(type_name)
        ActionServer(node, kind, action, lambda handle, kind=kind: kind.Result())
    for action, type_name in layout["action_clients"]:
        ActionClient(node, load_type(type_name), action)
    for topic, type_name, policies, rate in layout["publishers"]:
        kind = load_type(type_name)
        publisher = node.create_publisher(kind, topic, qos(policies))
        if rate:
            node.create_timer(
                1.0 / rate,
                lambda publisher=publisher, kind=kind: publisher.publish(kind()),
                clock=Clock(clock_type=ClockType.STEADY_TIME),
            )
    return node


if __name__ == "__main__":
    rclpy.init()
    file, wanted = sys.argv[1:]
    spin(make(wanted, json.loads(Path(file).read_text(encoding="utf-8"))[wanted]))
