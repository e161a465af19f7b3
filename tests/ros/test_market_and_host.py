# SPDX-License-Identifier: Apache-2.0
"""A real market and a real host: hundreds of scenes that each end once."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter

from active_nodes import active_host, active_market
from bt_agents_interfaces.msg import Auction, MarketStatus, Run, Scene, SceneEnd
from bt_agents_interfaces.srv import CollectFeedback
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.messages import scene_to_msg
from market_harness import scene
from processes import write_trees


class Street:
    """A market and a host on one executor, and their messages."""

    def __init__(self, ros: Any, folder: Path, wait: str, **parameters: Any) -> None:
        self.ros = ros
        agents = {"young": 1.5, "middle": 3.0, "old": 4.5}
        tree = f"wait: {wait}"
        write_trees(folder, **{name: (age, tree) for name, age in agents.items()})
        trees = read_trees(folder, InstalledInterfaces())
        # On one executor, heartbeats are late on a slow machine.
        parameters["host_lease"] = 10.0
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        ros.add(active_market(trees.scene.space, "epoch", parameter_overrides=overrides))
        lease = Parameter("market_lease", value=10.0)
        self.host = ros.add(active_host(trees, parameter_overrides=[lease]))
        ros.node.create_service(
            CollectFeedback, "feedback/collect", lambda _, r: r, qos_profile=qos.SERVICE
        )
        self.runs = ros.collect(Run, "bt_agents/runs", qos.FACTS)
        self.auctions = ros.collect(Auction, "bt_agents/auctions", qos.FACTS)
        self.ends = ros.collect(SceneEnd, "bt_agents/scene_ends", qos.FACTS)
        self.statuses = ros.collect(MarketStatus, "bt_agents/market", qos.FACT)
        self.scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
        self.sent = 0
        ros.until(lambda: self.host.registered and self.scenes.get_subscription_count())

    def send(self) -> None:
        self.sent += 1
        urgent = self.sent % 10 == 0
        now = scene(f"s{self.sent}", 1.0 + self.sent % 5, 3.0, 3.0, urgent=urgent)
        self.scenes.publish(scene_to_msg(now))

    def check(self) -> Counter[str]:
        """Wait for rest; check that each scene ended once and that no two runs overlapped."""
        self.ros.until(lambda: len(self.ends) >= self.sent)
        self.ros.until(lambda: self.statuses[-1].state == MarketStatus.IDLE)
        self.ros.turns()
        assert Counter(end.scene_id for end in self.ends) == Counter(
            f"s{number}" for number in range(1, self.sent + 1)
        )
        running = 0
        for run in self.runs:
            running += (run.event == Run.STARTED) - (run.event == Run.ENDED)
            assert running in (0, 1), "never two runs at a time"
        outcomes = Counter(run.outcome for run in self.runs if run.event == Run.ENDED)
        codes = Counter(end.code for end in self.ends)
        assert codes["SUCCEEDED"] == outcomes[Run.SUCCEEDED]
        assert codes["PREEMPTED"] == outcomes[Run.CANCELLED]
        assert outcomes.keys() <= {Run.SUCCEEDED, Run.CANCELLED}
        awarded = sum(auction.outcome == Auction.AWARDED for auction in self.auctions)
        assert awarded == sum(outcomes.values())
        assert [auction.round for auction in self.auctions] == list(
            range(1, len(self.auctions) + 1)
        )
        return codes


def test_all_600_queued_scenes_run(ros: Any, tmp_path: Path) -> None:
    street = Street(ros, tmp_path, "0 s", on_new_scene="queue", queue_limit=100)
    while street.sent < 600:
        street.send()
        ros.until(lambda: street.sent - len(street.ends) < 50)

    assert street.check() == {"SUCCEEDED": 600}


def test_200_scenes_preempt_one_another(ros: Any, tmp_path: Path) -> None:
    street = Street(
        ros,
        tmp_path,
        "0.1 s",
        on_new_scene="preempt",
        queue_limit=5,
        preempt_cooldown=0.0,
        preempt_margin=0.5,
    )
    while street.sent < 200:
        street.send()
        heard = len(street.auctions)
        ros.until(
            lambda heard=heard: len(street.auctions) > heard or len(street.ends) == street.sent
        )

    codes = street.check()
    assert codes.keys() <= {"SUCCEEDED", "PREEMPTED", "QUEUE_FULL"}
    assert codes["SUCCEEDED"] > 5
    assert codes["PREEMPTED"] > 5
