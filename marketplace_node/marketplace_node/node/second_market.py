# SPDX-License-Identifier: Apache-2.0
"""Refusal to start a second market; markets detect each other by their heartbeats."""

from __future__ import annotations

import os
import time

import rclpy
from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_interfaces.msg import MarketHeartbeat
from bt_agents_ros import qos
from bt_agents_ros.discovery import node_of
from bt_agents_ros.node_main import RESTARTED
from bt_agents_ros.signals import check_interrupt
from bt_agents_ros.spinner import Spinner
from marketplace_node.formatting import shown
from marketplace_node.other_market import StartCheck

MARKET_HEARTBEAT = "marketplace/heartbeat"
"""Topic on which hosts listen for their market, whatever the name of its node."""

_POLL_S = 0.02
_LONGEST_EPOCH = 200


def refuse_second_market() -> None:
    """Listen for another live market, and refuse to start if there is one.

    It does not listen if the parent of this process keeps other systems off the domain. If one
    appears nevertheless, heartbeats decide which market ends; see :class:`OtherMarket`.

    Raises:
        Refused: ``SECOND_MARKET``, with its epoch and its node.
        Interrupted: SIGINT or SIGTERM arrived.
    """
    if RESTARTED in os.environ:
        return
    listener = rclpy.create_node(
        "marketplace", start_parameter_services=False, enable_rosout=False
    )
    spinner = Spinner(listener)
    check = StartCheck(time.monotonic())

    def take(heartbeat: MarketHeartbeat) -> None:
        check.on_heartbeat(heartbeat.epoch, time.monotonic())

    try:
        listener.create_subscription(MarketHeartbeat, MARKET_HEARTBEAT, take, qos.SENSOR)
        while not check.is_over(
            now := time.monotonic(),
            is_on_graph=bool(listener.get_publishers_info_by_topic(MARKET_HEARTBEAT)),
        ):
            check_interrupt()
            spinner.spin_once(_POLL_S)
        if check.is_refused(now):
            raise Refused(RefusalCode.SECOND_MARKET, another_market_text(listener, check.alive))
    finally:
        spinner.close()


def another_market_text(node: Node, epoch: str) -> str:
    """Return in words that another market is alive, and which one."""
    nodes = {*map(node_of, node.get_publishers_info_by_topic(MARKET_HEARTBEAT))} - {""}
    return (
        f"another marketplace is alive here: epoch '{shown(epoch[:_LONGEST_EPOCH])}', node "
        f"{' or '.join(sorted(nodes)) or '(unknown)'}; end one of the two, or set ROS_DOMAIN_ID "
        "or ROS_NAMESPACE to another value for this one"
    )
