# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the bare rclpy programs: QoS, and the executor of our nodes."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from bt_agents_ros.workarounds.cached_executor import CachedExecutor

EVENTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""QoS of all event topics and of all services of the system."""

SERVICES = {
    "goal_service_qos_profile": EVENTS,
    "result_service_qos_profile": EVENTS,
    "cancel_service_qos_profile": EVENTS,
}
"""QoS of both ends of actions."""

LATCHED = QoSProfile(
    depth=50, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""QoS of the history of decisions."""


def executor(context: Any = None) -> Any:
    """Return the executor that both sides of every benchmark use."""
    return CachedExecutor(context=context)


def spin(*nodes: Node, turner: Any = None) -> None:
    """Report that the nodes exist, and spin them until the parent kills the process or ends.

    Args:
        nodes: The nodes.
        turner: Executor to use instead of :func:`executor`.
    """
    turner, parent_id = turner or executor(), os.getppid()
    for node in nodes:
        turner.add_node(node)
    descriptor = os.environ.pop("BT_AGENTS_READY", "")
    if descriptor:
        with suppress(OSError), os.fdopen(int(descriptor), "wb") as parent:
            parent.write(b"up")
    while rclpy.ok() and os.getppid() == parent_id:
        turner.spin_once(timeout_sec=0.1)
