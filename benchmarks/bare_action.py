# SPDX-License-Identifier: Apache-2.0
"""A bare node with one action server."""

from __future__ import annotations

import rclpy
from rclpy.action import ActionServer

from bare import spin
from bt_agents_interfaces.action import RunAgent

if __name__ == "__main__":
    rclpy.init()
    node = rclpy.create_node("bare")
    ActionServer(node, RunAgent, "~/run", lambda _: RunAgent.Result())
    spin(node)
