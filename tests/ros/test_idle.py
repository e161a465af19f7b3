# SPDX-License-Identifier: Apache-2.0
"""Nodes that have nothing to do: how often they wake up."""

from __future__ import annotations

from pathlib import Path

import pytest
from rclpy.node import Node

from fake_market import folder, make_host
from graph import Ros
from market_harness import SPACE
from marketplace_node.node import MarketplaceNode

pytestmark = pytest.mark.ros

AGENT = """
format: 1
agent: talker
title: Talker
description: says one thing
profile: {age: 3, familiarity: 3, mood: 3}
tree: {say: hello}
"""


def rings(node: Node) -> float:
    """Return how often all timers of a node ring together [1/s]."""
    return sum(1e9 / timer.timer_period_ns for timer in node.timers if not timer.is_canceled())


def test_a_market_without_a_scene_wakes_up_for_its_heartbeat_only(ros: Ros) -> None:
    market = ros.add(MarketplaceNode(SPACE))
    ros.turns()
    assert rings(market) == pytest.approx(10)


def test_a_host_without_a_run_wakes_up_for_its_heartbeat_and_for_changed_files(
    ros: Ros, tmp_path: Path
) -> None:
    host = ros.add(make_host(folder(tmp_path, AGENT)))
    ros.until(lambda: rings(host) < 15)
    assert rings(host) >= 10
