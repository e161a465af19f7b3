# SPDX-License-Identifier: Apache-2.0
"""The whole system in one process and one executor, for tests of all parts together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from active_nodes import active_feedback, active_host, active_market, active_scene_layer
from bt_agents_interfaces.msg import Auction, Feedback, MarketStatus, Profiles, Run, SceneEnd
from bt_agents_interfaces.srv import Analyze
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from feedback_node.ledger import Ledger
from market_node_harness import is_recorded
from tree_harness import agent_text, trees_folder

AGENT = """requires: scene.person
feedback:
  - {when: mood.change <= -1, for: 0 s, give: negative, then: cancel}"""


def write_agents(tmp_path: Path, wait: str = "0 s", **ages: float) -> Path:
    texts = {
        name: agent_text(name, f"wait: {wait}", AGENT, (age, 3, 3)) for name, age in ages.items()
    }
    return trees_folder(tmp_path / f"trees{len(list(tmp_path.iterdir()))}", texts)


class System:
    """Market, scene layer, feedback and one host on one executor."""

    def __init__(
        self, ros: Any, trees: Path, robot: str = "", epoch: str | None = "epoch"
    ) -> None:
        self.ros = ros
        self.folder = read_trees(trees, InstalledInterfaces(), robot)
        space = self.folder.scene.space
        self.market = ros.add(active_market(space, epoch))
        self.scene_layer = ros.add(active_scene_layer(self.folder.scene))
        self.feedback = ros.add(active_feedback(space, Ledger(":memory:")))
        self.host = ros.add(active_host(self.folder))
        self.auctions = ros.collect(Auction, "bt_agents/auctions", qos.HISTORY)
        self.runs = ros.collect(Run, "bt_agents/runs", qos.HISTORY)
        self.ends = ros.collect(SceneEnd, "bt_agents/scene_ends", qos.FACTS)
        self.feedback_given = ros.collect(Feedback, "bt_agents/feedback", qos.HISTORY)
        self.statuses = ros.collect(MarketStatus, "bt_agents/market", qos.FACT)
        self.profiles = ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
        ros.until(lambda: self.host.registered)
        ros.until(
            lambda: self.profiles and len(self.profiles[-1].agents) >= len(self.folder.agents)
        )

    def analyze(
        self, announce: bool = True, person: int = Analyze.Request.PRESENT, **values: float
    ) -> Any:
        client = self.ros.node.create_client(Analyze, "scene_layer/analyze")
        request = Analyze.Request(
            names=list(values),
            values=[float(value) for value in values.values()],
            person=person,
            announce=announce,
        )
        return self.ros.call(client, request)

    def finished(self, scene_id: str) -> bool:
        """Return whether a scene is over and the records of its last round are received."""
        over = any(status.finished_scene_id == scene_id for status in self.statuses)
        return over and is_recorded(scene_id, self.ends, self.auctions)

    def interact(self, **values: float) -> str:
        """Trigger a scene and wait for its end; return the last winner."""
        scene_id = self.analyze(**values).scene.scene_id
        self.ros.until(lambda: self.finished(scene_id))
        return str(self.auctions[-1].winner)
