# SPDX-License-Identifier: Apache-2.0
"""``/diagnostics`` of every node: once a second, and after every change."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from active_nodes import active_feedback, active_host, active_market, active_scene_layer
from bt_agents_lab.node import JournalNode
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from checkout import ROOT
from feedback_node.ledger import Ledger

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Monitor:
    """The view of a diagnostics monitor: the newest status of each part."""

    def __init__(self, ros: Any) -> None:
        self._ros = ros
        self._received = ros.collect(DiagnosticArray, "/diagnostics", qos.EVENTS)

    def status(self, name: str) -> Any:
        for message in reversed(self._received):
            for status in message.status:
                if status.name == name:
                    return status
        return None

    def until(self, name: str, level: bytes, words: str = "") -> Any:
        def is_told() -> bool:
            status = self.status(name)
            return status is not None and status.level == level and words in status.message

        self._ros.until(is_told)
        return self.status(name)

    def count(self, name: str) -> int:
        return sum(status.name == name for message in self._received for status in message.status)


def test_diagnostics_report_every_component_with_level_and_values(
    ros: Any, tmp_path: Path
) -> None:
    monitor = Monitor(ros)
    folder = Path(shutil.copytree(ROOT / "trees", tmp_path / "trees"))
    (folder / "agents" / "broken.yaml").write_text("format: 1\nagent: broken\n")
    trees = read_trees(folder, InstalledInterfaces())
    space = trees.scene.space
    ros.add(active_market(space, "epoch"))
    nobody = monitor.until("marketplace: hosts", WARN)
    assert nobody.message == "no host has registered, so nobody bids"
    host = ros.add(active_host(trees))
    ros.add(active_scene_layer(trees.scene))
    ros.add(active_feedback(space, Ledger(":memory:")))
    ros.add(JournalNode(tmp_path / "journal"))
    hosts = monitor.until("marketplace: hosts", OK)
    assert hosts.hardware_id == "marketplace"
    assert {one.key: one.value for one in hosts.values} == {
        "/agents": f"{len(trees.agents)} agents"
    }
    assert "broken.yaml" in monitor.until("agents: files", ERROR).message
    for name in ("marketplace: queue", "agents: ticks", "agents: servers", "journal: recording"):
        monitor.until(name, OK)
    for name in ("feedback: ledger", "feedback: profiles"):
        monitor.until(name, OK)
    monitor.until("scene_layer: sources", WARN, "no reading so far")
    names, began = ("agents: ticks", "scene_layer: sources"), time.monotonic()
    before = [monitor.count(name) for name in names]
    ros.until(lambda: all(monitor.count(n) >= b + 3 for n, b in zip(names, before, strict=True)))
    assert time.monotonic() - began > 1.5
    ros.remove(host)
    gone = monitor.until("marketplace: hosts", ERROR)
    assert gone.message == "1 of 1 hosts cannot be asked: /agents (it has no heartbeat)"
