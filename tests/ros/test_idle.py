# SPDX-License-Identifier: Apache-2.0
"""Wake-ups of idle nodes."""

from __future__ import annotations

from pathlib import Path

import pytest
from rclpy.node import Node
from std_msgs.msg import Empty

from active_nodes import active_market
from bt_agents_ros import qos
from bt_agents_studio.node import StudioNode
from fake_market import agent_text, folder, make_host
from graph import Ros
from market_harness import SPACE

AGENT = agent_text("talker", "say: hello")


def rings(node: Node) -> float:
    """Return the rate of all timers of a node together [1/s]."""
    return sum(1e9 / timer.timer_period_ns for timer in node.timers if not timer.is_canceled())


def test_idle_market_wakes_only_for_heartbeat(ros: Ros) -> None:
    market = ros.add(active_market(SPACE))
    ros.turns()
    assert rings(market) == pytest.approx(5)


def test_idle_host_wakes_only_for_heartbeat_and_files(ros: Ros, tmp_path: Path) -> None:
    host = ros.add(make_host(folder(tmp_path, AGENT)))
    ros.until(lambda: rings(host) < 10)
    assert rings(host) >= 5


def test_unwatched_studio_traces_nothing_and_reads_no_graph(ros: Ros, tmp_path: Path) -> None:
    read: list[object] = []
    studio = ros.add(StudioNode(*[lambda *_values: None] * 3, lambda *values: read.append(values)))
    ros.add(active_market(SPACE))
    ros.add(make_host(folder(tmp_path, AGENT)))
    ros.until(lambda: studio.count_subscribers("agents/status"))
    assert not read
    assert rings(studio) < 1

    beats = ros.collect(Empty, "studio/person/heartbeat", qos.SENSOR)

    def traced() -> int:
        return int(ros.node.count_subscribers("agents/details"))

    assert not traced()
    for is_person in (False, True):
        read.clear()
        beats.clear()
        studio.watch(True, is_person)
        ros.until(lambda: read and traced() == 1)
        if is_person:
            ros.until(lambda: len(beats) > 1)
        studio.watch(False)
        ros.until(lambda: not traced())
        assert rings(studio) < 1
