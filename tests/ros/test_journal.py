# SPDX-License-Identifier: Apache-2.0
"""The journal of real nodes: every message is recorded, with the traces of all runs."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mcap.reader import make_reader

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import RecordingStatus, StatusChange
from bt_agents_interfaces.srv import Record
from bt_agents_lab.node import JournalNode
from bt_agents_lab.recorder.reading import JournalReader, recording_label
from bt_agents_lab.replay.recording_index import index_entries
from bt_agents_ros import qos
from fake_market import Market, agent_text, folder
from scripted_server import Script, ScriptedServer

START, STOP, BOOKMARK = Record.Request.START, Record.Request.STOP, Record.Request.BOOKMARK
TREES = {
    "talker": "{sequence: [{say: hello}, {say: again}]}",
    "setter": "{sequence: [{set: {way: left}}, {set: {steps: 3}}]}",
}


class JournalHarness:
    """A market, a host, a say server and a journal on one executor."""

    def __init__(self, ros: Any, path: Path) -> None:
        self.ros = ros
        trees = folder(path, *(agent_text(name, tree) for name, tree in TREES.items()))
        self.today = date(2026, 3, 1)
        self.files = path / "journal"
        ScriptedServer(ros, script=Script(finish_s=0.05))
        self.market = Market(ros)
        self.host = self.market.host(trees)
        self._round = 0

    def record(self) -> JournalNode:
        """Start a journal; return it once it receives the host's topics and has its texts."""
        journal: JournalNode = self.ros.add(JournalNode(self.files, today=lambda: self.today))
        self.ros.until(self.host._runs._status.get_subscription_count)
        self.ros.until(lambda: "/agents/files" in journal.journal._facts)
        return journal

    def run(self, agent: str) -> Any:
        """Run an agent to its end; return the outcome."""
        self._round += 1
        goal = self.market.goal(self.host, agent, round=self._round)
        return self.market.result(self.market.send(goal)).result

    def ask(self, action: int, **fields: Any) -> Any:
        """Ask the journal to record; return its answer."""
        return self.ros.ask(Record, "journal/record", action=action, **fields)

    def recordings(self) -> list[Path]:
        """Return the files of the journal, oldest first."""
        return sorted(self.files.glob("*.mcap"))

    def report(self, *names: str, sent: int = 5, **fields: Any) -> None:
        """Publish the health of some parts of a node a few times."""
        publisher = self.ros.node.create_publisher(DiagnosticArray, "/diagnostics", qos.EVENTS)
        self.ros.until(publisher.get_subscription_count)
        for name in names * sent:
            status = DiagnosticStatus(name=name, hardware_id=name.partition(":")[0], **fields)
            publisher.publish(DiagnosticArray(status=[status]))
            self.ros.turns()

    def elements(self, file: Path) -> list[tuple[str, int, dict[str, str]]]:
        """Return path, status and values of all elements of traces in a file."""
        entries = JournalReader([file]).entries({"bt_agents_interfaces/msg/TreeStatus"})
        return [
            (change.path, change.status, {one.name: one.value for one in change.values})
            for entry in entries
            for change in entry.decode().changes
        ]


def health(file: Path, node: str) -> list[tuple[str, str]]:
    """Return name and message of all recorded health of a node."""
    return [
        (status.name, status.message)
        for entry in JournalReader([file]).entries()
        if entry.topic == "/diagnostics"
        for status in entry.decode().status
        if status.hardware_id == node
    ]


@pytest.fixture
def harness(ros: Any, tmp_path: Path) -> Iterator[JournalHarness]:
    return JournalHarness(ros, tmp_path)


def test_each_day_records_traces_of_its_runs(harness: JournalHarness) -> None:
    journal = harness.record()
    assert harness.run("talker").outcome == RunAgent.Result.SUCCEEDED
    harness.today += timedelta(days=1)
    assert harness.run("setter").outcome == RunAgent.Result.SUCCEEDED
    harness.ros.remove(journal)
    first, second = harness.recordings()
    assert {path for path, _, _ in harness.elements(first)} == {"tree", "tree/0.say", "tree/1.say"}
    assert ("tree/1.say", StatusChange.SUCCESS, {}) in harness.elements(first)
    assert harness.elements(second) == [
        ("tree/0.set", StatusChange.SUCCESS, {"way": "'left'"}),
        ("tree/1.set", StatusChange.SUCCESS, {"steps": "3"}),
        ("tree", StatusChange.SUCCESS, {}),
    ]
    assert index_entries(JournalReader([second]).entries()).counts["/bt_agents/cards"] >= 1


def test_second_journal_in_same_folder_is_refused(ros: Any, tmp_path: Path) -> None:
    ros.add(JournalNode(tmp_path / "journal"))
    with pytest.raises(Refused, match="another journal writes"):
        JournalNode(tmp_path / "journal")
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(BtAgentsError, match="no place for the journal"):
        JournalNode(blocked / "journal")


def test_service_starts_marks_and_stops_recording(harness: JournalHarness) -> None:
    ros, journal = harness.ros, harness.record()
    states = ros.collect(RecordingStatus, "journal/status", qos.FACT)
    ros.until(lambda: states)
    assert states[-1].recording
    again = harness.ask(START, label="morning")
    assert (again.accepted, again.code) == (False, "RECORDING_ALREADY")
    assert harness.ask(STOP).accepted
    assert harness.ask(START, label="morning", notes="a class").accepted
    assert harness.ask(BOOKMARK, label="odd", author="anna").accepted
    ros.until(lambda: states[-1].bookmarks == 1)
    past = harness.ask(BOOKMARK, age_s=3600.0)
    assert (past.accepted, past.code) == (False, "OUT_OF_RANGE")
    assert harness.ask(START, label="a" * 201).code == "TOO_LARGE"
    assert harness.ask(9).code == "UNKNOWN_ACTION"
    ros.remove(journal)

    newest = harness.recordings()[-1]
    assert recording_label(newest) == "morning"
    recording = index_entries(JournalReader([newest]).entries())
    [status] = recording.recordings.values()
    assert (status.label, status.notes, status.bookmarks) == ("morning", "a class", 1)
    assert [(one.label, one.author) for one in recording.bookmarks] == [("odd", "anna")]
    assert recording.counts["/agents/files"] == 1


def test_acknowledged_label_and_bookmark_are_in_file(
    harness: JournalHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bt_agents_lab.node.FLUSH_S", 3600.0)
    harness.record()
    assert harness.ask(STOP).accepted
    assert harness.ask(START, label="morning").accepted
    assert recording_label(harness.recordings()[-1]) == "morning"
    assert harness.ask(BOOKMARK, label="odd").accepted
    recording = index_entries(JournalReader([harness.recordings()[-1]]).entries())
    assert [one.label for one in recording.bookmarks] == ["odd"]


def test_journal_file_fits_ros2_bag_and_foxglove(harness: JournalHarness) -> None:
    journal = harness.record()
    harness.ros.until(lambda: "/agents/trees" in journal.journal._facts)
    journal.journal.close()
    [file] = harness.recordings()
    with file.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary is not None
    assert {one.encoding for one in summary.schemas.values()} == {"ros2msg"}
    assert {one.compression for one in summary.chunk_indexes} <= {"", "zstd"}
    offered = {}
    for channel in summary.channels.values():
        assert channel.message_encoding == "cdr"
        assert summary.schemas[channel.schema_id].data
        [offered[channel.topic]] = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    # Numbers of rmw, which every version of rosbag2 reads.
    for profile in offered.values():
        assert profile["history"] in (1, 2)
        assert profile["reliability"] in (1, 2)
        assert profile["durability"] in (1, 2)
        assert isinstance(profile["depth"], int)
        assert profile["liveliness"] == 1
        assert profile["avoid_ros_namespace_conventions"] is False
        for time in ("deadline", "lifespan", "liveliness_lease_duration"):
            assert profile[time] == {"sec": 9223372036, "nsec": 854775807}
    # Latched, because late subscribers of a playback need it.
    trees = offered["/agents/trees"]
    assert (trees["history"], trees["reliability"], trees["durability"]) == (1, 1, 1)


def test_health_changes_are_recorded_per_part_and_file(harness: JournalHarness) -> None:
    journal = harness.record()
    harness.report("arm: left", "arm: right")
    harness.report("eye: lens", level=DiagnosticStatus.OK, message="clear")
    harness.report("eye: lens", level=DiagnosticStatus.WARN, message="dusty")
    harness.report("eye: lens", level=DiagnosticStatus.OK, message="clear", sent=1)
    harness.today += timedelta(days=1)
    harness.run("talker")
    harness.ros.until(lambda: len(harness.recordings()) == 2)
    journal.journal.flush(0)
    today, tomorrow = harness.recordings()
    assert health(today, "arm") == [("arm: left", ""), ("arm: right", "")]
    first, second = health(today, "eye"), health(tomorrow, "eye")
    assert [message for _, message in first] == ["clear", "dusty", "clear"]
    assert second == [("eye: lens", "clear")]
