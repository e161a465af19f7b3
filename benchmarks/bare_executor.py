# SPDX-License-Identifier: Apache-2.0
"""A bare node that answers, spun by an executor: ``bare_executor.py lean``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from std_msgs.msg import Empty, String
from std_srvs.srv import Trigger

from bare import EVENTS, spin
from bt_agents_ros.workarounds.cached_executor import CachedExecutor

KINDS: dict[str, Callable[..., Any]] = {
    "single": SingleThreadedExecutor,
    "lean": CachedExecutor,
    "events": EventsExecutor,
}
"""Executors of rclpy, and ours."""

_BEAT_S = 0.1


def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
    """Answer a request."""
    response.success = True
    return response


def echo(node: Node) -> None:
    """Make a node republish messages of ``asked`` on ``told``, and answer requests of ``ask``."""
    tells = node.create_publisher(String, "told", EVENTS)
    node.create_subscription(String, "asked", tells.publish, EVENTS)
    node.create_service(Trigger, "ask", answer, qos_profile=EVENTS)


if __name__ == "__main__":
    rclpy.init()
    there = rclpy.create_node("there", enable_rosout=False)
    echo(there)
    beats = there.create_publisher(Empty, "heartbeat", EVENTS)
    there.create_timer(
        _BEAT_S, lambda: beats.publish(Empty()), clock=Clock(clock_type=ClockType.STEADY_TIME)
    )
    spin(there, turner=KINDS[sys.argv[1]]())
