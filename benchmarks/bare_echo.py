# SPDX-License-Identifier: Apache-2.0
"""A process that joins late and calls an existing one until it receives an answer.

``bare_echo.py`` answers; ``bare_echo.py late`` asks, prints how long it took [s], and ends.
"""

from __future__ import annotations

import sys
import time

import rclpy
from std_msgs.msg import Empty

from bare import EVENTS, executor, spin

LIMIT_S = 20.0
_AGAIN_S = 0.005


def ask() -> float:
    """Return how long it takes from joining the graph to the first answer [s]."""
    heard: list[float] = []
    began = time.perf_counter()
    rclpy.init()
    node = rclpy.create_node("late")
    asks = node.create_publisher(Empty, "asked", EVENTS)
    node.create_subscription(Empty, "told", lambda _: heard.append(time.perf_counter()), EVENTS)
    turner = executor()
    turner.add_node(node)
    while not heard and time.perf_counter() - began < LIMIT_S:
        asks.publish(Empty())
        turner.spin_once(timeout_sec=_AGAIN_S)
    return heard[0] - began


def answer() -> None:
    """Answer until the process is killed."""
    rclpy.init()
    node = rclpy.create_node("there")
    tells = node.create_publisher(Empty, "told", EVENTS)
    node.create_subscription(Empty, "asked", tells.publish, EVENTS)
    spin(node)


if __name__ == "__main__":
    if sys.argv[1:]:
        print(ask(), flush=True)
    else:
        answer()
