# SPDX-License-Identifier: Apache-2.0
"""The journal of real nodes: messages are recorded, and their trees go the same way again."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

from bt_agents.host.node import HostNode
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import RunRecord, Scene
from bt_agents_interfaces.srv import ReloadAgents
from bt_agents_lab.node import JournalNode
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.replay.findings import FindingCounts, ReplayVerdict
from bt_agents_lab.replay.recording_index import RecordingIndex, index_entries
from bt_agents_lab.replay.trees import replay_runs
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from fake_market import Market, folder, make_host
from scripted_server import Script, ScriptedServer
from tree_harness import scene

pytestmark = pytest.mark.ros

AGENT = """
format: 1
agent: {name}
title: {name}
description: d
profile: {{age: 3, familiarity: 3, mood: 3}}
tunables:
  patience: {{default: 9 s, min: 0 s, max: 60 s, description: d}}
on_cancel: {{say: good-bye}}
tree:
{tree}
"""
TREES = {
    "talker": "  sequence: [{say: hello}, {say: again}]",
    "listener": (
        "  wait_for: {topic: button, type: std_msgs/msg/Bool, until: msg.data}\n"
        "  timeout: ${patience}"
    ),
    "gambler": (
        "  random:\n    - {set: {way: left}}\n    - {set: {way: right}}\n    - {log: nothing}"
    ),
    "watcher": "  while: live.mood > 2\n  say: all is well",
}


class Town:
    """A market, a host, a mouth and a journal on one executor."""

    def __init__(self, ros: Any, path: Path) -> None:
        self.ros = ros
        self.folder = folder(
            path, *(AGENT.format(name=name, tree=tree) for name, tree in TREES.items())
        )
        self.today = date(2026, 3, 1)
        self.files = path / "journal"
        self.mouth = ScriptedServer(ros, script=Script(finish_s=0.05))
        self.market = Market(ros)
        self.host: HostNode = ros.add(make_host(self.folder))
        self.live = ros.node.create_publisher(Scene, "scene/live", qos.SENSOR)
        self.button = ros.node.create_publisher(Bool, "button", qos.EVENTS)
        self.market.open()
        ros.until(lambda: self.host.registered)
        self._round = 0

    def record(self) -> JournalNode:
        """Start a journal; return it when it receives the host's topics and has its texts."""
        journal: JournalNode = self.ros.add(JournalNode(self.files, today=lambda: self.today))
        self.ros.until(self.host._runs._records._has_subscribers)
        self.ros.until(lambda: "/agents/files" in journal.journal._facts)
        return journal

    def begin(self, agent: str) -> Any:
        """Begin a run of an agent."""
        self._round += 1
        return self.market.send(self.market.goal(self.host, agent, round=self._round))

    def run(self, agent: str) -> Any:
        """Run an agent to its end; return how it ended."""
        return self.market.result(self.begin(agent)).result

    def recording(self) -> RecordingIndex:
        """Return the contents of all files."""
        return index_entries(JournalReader(sorted(self.files.glob("*.mcap"))).entries())


@pytest.fixture
def town(ros: Any, tmp_path: Path) -> Iterator[Town]:
    return Town(ros, tmp_path)


def test_runs_of_every_kind_go_the_same_way_again(town: Town) -> None:
    ros, journal = town.ros, town.record()
    assert town.run("talker").outcome == RunAgent.Result.SUCCEEDED
    for _ in range(3):
        town.run("gambler")

    handle = town.begin("listener")
    ros.until(lambda: town.button.get_subscription_count())
    town.button.publish(Bool(data=False))
    [answer] = town.host.set_parameters([Parameter("listener.patience", value=30.0)])
    assert answer.successful
    ros.turns()
    town.button.publish(Bool(data=True))
    assert town.market.result(handle).result.outcome == RunAgent.Result.SUCCEEDED

    town.mouth.script = Script(finish_s=None)
    handle = town.begin("watcher")
    ros.until(lambda: len(town.mouth.goals) == 3)
    sad = scene("s1", age=3, familiarity=3, mood=1)

    def failed() -> bool:
        town.live.publish(scene_to_msg(sad))
        return bool(town.mouth.goals[-1].cancels)

    ros.until(failed)
    assert town.market.result(handle).result.outcome == RunAgent.Result.FAILED

    handle = town.begin("talker")
    ros.until(lambda: len(town.mouth.goals) == 4)
    town.mouth.script = Script(finish_s=0.05)
    ros.call(ros.node.create_client(ReloadAgents, "agents/reload"), ReloadAgents.Request())
    file = town.folder / "agents" / "0.yaml"
    file.write_text(file.read_text().replace("again", "once more"))
    ros.call(ros.node.create_client(ReloadAgents, "agents/reload"), ReloadAgents.Request())
    handle.cancel_goal_async()
    assert town.market.result(handle).result.outcome == RunAgent.Result.CANCELLED
    assert town.run("talker").outcome == RunAgent.Result.SUCCEEDED
    assert town.mouth.goals[-1].request.text == "once more"

    ros.until(lambda: len(journal._hosts) == 1)
    ros.remove(journal)
    recording = town.recording()
    found = FindingCounts(replay_runs(recording.runs.values()))
    assert [one.text for one in found.unequal] == []
    assert found.counts == {("run of a tree", ReplayVerdict.EQUAL): 8}
    assert recording.problems == []
    assert recording.lost == {}
    assert recording.counts["/agents/files"] == 2


def test_nothing_is_recorded_while_nobody_listens(town: Town) -> None:
    records = town.ros.collect(RunRecord, "agents/records", qos.EVENTS)
    assert town.run("talker").outcome == RunAgent.Result.SUCCEEDED
    town.ros.turns()
    # Notes without the status of the tree could not be compared with anything.
    assert records == []


def test_a_journal_that_comes_late_says_what_it_has_not_heard(town: Town) -> None:
    town.mouth.script = Script(finish_s=None)
    handle = town.begin("talker")
    town.ros.until(lambda: town.mouth.goals)
    journal = town.record()
    town.mouth.script = Script()
    town.mouth.goals[0].finish()
    town.market.result(handle)
    town.run("talker")
    town.ros.remove(journal)
    found = FindingCounts(replay_runs(town.recording().runs.values()))
    assert [one.text for one in found.unequal] == [
        "nothing was recorded of what its tree received"
    ]
    assert found.counts["run of a tree", ReplayVerdict.EQUAL] == 1


def test_each_day_can_be_done_again_by_itself(town: Town) -> None:
    journal = town.record()
    town.run("talker")
    town.today += timedelta(days=1)
    town.run("gambler")
    town.ros.remove(journal)
    for path in sorted(town.files.glob("*.mcap")):
        recording = index_entries(JournalReader([path]).entries())
        found = FindingCounts(replay_runs(recording.runs.values()))
        assert found.counts == {("run of a tree", ReplayVerdict.EQUAL): 1}
        assert recording.counts["/cards"] >= 1


def test_a_second_journal_in_the_same_folder_is_refused(town: Town, tmp_path: Path) -> None:
    town.record()
    with pytest.raises(Refused, match="another journal writes"):
        JournalNode(town.files, today=lambda: town.today)
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(BtAgentsError, match="no place for the journal"):
        JournalNode(blocked / "journal")
