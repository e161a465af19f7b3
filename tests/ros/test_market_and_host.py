# SPDX-License-Identifier: Apache-2.0
"""A real market and a real host: a thousand scenes that each end once, and a market that dies."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

from active_nodes import active_host, active_market
from bt_agents_interfaces.msg import Auction, MarketStatus, Run, Scene, SceneEnd, SceneValue
from bt_agents_interfaces.srv import CollectFeedback
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[2]
AGES = {"young": 1.5, "middle": 3.0, "old": 4.5}
AGENT = """
format: 1
agent: {name}
title: {name}
description: d
profile: {{age: {age}, familiarity: 3, mood: 3}}
tree: {{wait: "{wait}"}}
"""


class Street:
    """A market and a host on one executor, and their messages; scenes come at once or in turn."""

    def __init__(self, ros: Any, folder: Path, wait: str, **parameters: Any) -> None:
        self.ros = ros
        shutil.copytree(ROOT / "trees" / "skills", folder / "skills")
        shutil.copy(ROOT / "trees" / "scene.yaml", folder)
        (folder / "agents").mkdir()
        for name, age in AGES.items():
            text = AGENT.format(name=name, age=age, wait=wait)
            (folder / "agents" / f"{name}.yaml").write_text(text)
        trees = read_trees(folder, InstalledInterfaces())
        # On one executor, heartbeats are late on a slow machine.
        parameters["host_lease"] = 10.0
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self.space = trees.scene.space
        self.market = ros.add(active_market(self.space, "epoch", parameter_overrides=overrides))
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
        age = 1.0 + self.sent % 5
        values = {"age": age, "familiarity": 3.0, "mood": 3.0}
        self.scenes.publish(
            Scene(
                scene_id=f"s{self.sent}",
                person=True,
                urgent=self.sent % 10 == 0,
                values=[
                    SceneValue(name=name, value=value, origin=SceneValue.GIVEN)
                    for name, value in values.items()
                ],
            )
        )

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


def test_market_rejects_scenes_that_arrive_while_busy(ros: Any, tmp_path: Path) -> None:
    street = Street(ros, tmp_path, "0 s", on_new_scene="reject")
    for number in range(100):
        street.send()
        street.send()
        ros.until(lambda number=number: len(street.ends) >= 2 * (number + 1))

    assert street.check() == {"SUCCEEDED": 100, "BUSY": 100}


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


@pytest.mark.parametrize("mode", ["queue", "reject", "preempt"])
def test_hundred_scenes_in_one_second_all_end(ros: Any, tmp_path: Path, mode: str) -> None:
    street = Street(ros, tmp_path, "0.05 s", on_new_scene=mode, preempt_cooldown=0.2)
    start = time.monotonic()
    while street.sent < 100:
        if time.monotonic() >= start + street.sent / 100:
            street.send()
        ros.executor.spin_once(timeout_sec=0.002)
    codes = street.check()

    refusal = {"queue": "QUEUE_FULL", "reject": "BUSY", "preempt": "QUEUE_FULL"}[mode]
    assert codes.keys() <= {"SUCCEEDED", "PREEMPTED", refusal}
    assert codes["SUCCEEDED"] >= 1


def test_scene_interrupted_by_dead_market_reruns_once(ros: Any, tmp_path: Path) -> None:
    street = Street(ros, tmp_path, "4 s")
    street.send()
    ros.until(lambda: any(run.event == Run.STARTED for run in street.runs))
    ros.remove(street.market)
    street.market = ros.add(active_market(street.space, "epoch-2"))
    ros.until(lambda: len(street.ends) == 2)
    ros.turns(50)

    assert [(end.scene_id, end.code, end.epoch) for end in street.ends] == [
        ("s1", "LOST", "epoch-2"),
        ("s1+again", "SUCCEEDED", "epoch-2"),
    ]
    ended = [run for run in street.runs if run.event == Run.ENDED]
    assert [(run.epoch, run.round, run.outcome) for run in ended] == [
        ("epoch", 1, Run.CANCELLED),
        ("epoch-2", 1, Run.SUCCEEDED),
    ]
