# SPDX-License-Identifier: Apache-2.0
"""A run under a flood of forged heartbeats of its host or its market."""

from __future__ import annotations

import time
from typing import Any

import pytest
from rclpy.serialization import serialize_message

from bt_agents_interfaces.msg import Heartbeat, MarketHeartbeat
from bt_agents_ros import qos
from processes import System, write_trees

pytestmark = pytest.mark.e2e

LEASE_S = 2.5
"""Lease of host and market [s]."""

FLOOD_S = 7.0
"""Length of a flood, several leases [s]."""

EACH_SECOND = 20_000
"""Forged heartbeats a second, about as many as a Python process can send."""

AT_A_TIME = 500
"""Heartbeats that are sent before the probe spins again."""


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("agents/heartbeat", Heartbeat(host="/agents", host_instance="another")),
        ("marketplace/heartbeat", MarketHeartbeat(epoch="another")),
    ],
    ids=["of the host", "of the market"],
)
def test_run_continues_under_heartbeat_flood(system: System, topic: str, message: Any) -> None:
    trees = write_trees(system.folder / "trees", leo=(5, "say: leo speaks"))
    system.market(trees, collect_deadline=0.05, bid_deadline=5.0, host_lease=LEASE_S)
    system.host("agents", trees, market_lease=LEASE_S)
    system.until_ready(hosts=1, agents=1)
    system.heartbeat_probe("agents")
    system.old_person("s1")
    system.until_speaking("leo speaks")
    system.until(lambda: system.started("leo"), "the start")
    publisher = system.ros.node.create_publisher(type(message), topic, qos.EVENTS)
    system.until(publisher.get_subscription_count, "somebody hears the flood")
    serialized = serialize_message(message)
    before, sent, began = len(system.statuses), 0, time.monotonic()

    def is_over() -> bool:
        nonlocal sent
        lasted_s = time.monotonic() - began
        due = min(int(EACH_SECOND * lasted_s) - sent, AT_A_TIME)
        for _ in range(due):
            publisher.publish(serialized)
        sent += due
        return lasted_s > FLOOD_S

    system.until(is_over, "the end of the flood")
    assert system.ended() == []
    assert all(status.hosts == 1 for status in system.statuses[before:])
    system.say_server.finish()
    assert system.until_end_of("s1").code == "SUCCEEDED"
