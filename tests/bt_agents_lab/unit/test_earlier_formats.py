# SPDX-License-Identifier: Apache-2.0
"""Journals of earlier versions, read as if this one had made them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bt_agents_lab.recorder.earlier_formats import present_name
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.replay.recording_index import read
from bt_agents_ros.system_topics import PREFIX, TOPICS
from bt_agents_studio.studio import read_journal
from journal_fixture import morning

RECORDED = Path(__file__).parents[2] / "recordings" / "journal_without_prefix_and_headers.mcap"
"""Of ``bt-agents up``: three runs, one of them stopped by a mood rule, and a marked moment."""

OF_NOW = {f"/{topic.name}" for topic in TOPICS if topic.name.startswith(PREFIX)}


def test_its_topics_have_the_names_of_now() -> None:
    reader = JournalReader([RECORDED])
    stored = {one.channel.topic for one in reader.stored(RECORDED)}
    assert not stored & OF_NOW
    read_as = {one.topic for one in reader.entries()}
    assert len(read_as) == len(stored)
    assert {"/bt_agents/runs", "/bt_agents/scene", "/bt_agents/scene/live"} <= read_as
    assert read_as - OF_NOW == {name for name in stored if f"/{PREFIX}{name[1:]}" not in OF_NOW}


def test_its_messages_and_the_scenes_in_them_have_the_header_of_now_with_their_stamp() -> None:
    reader = JournalReader([RECORDED])
    stamps = {}
    for one in reader.stored(RECORDED):
        if one.schema.name == "bt_agents_interfaces/msg/Run":
            stamp = one.decoder(one.message.data).stamp
            stamps[one.message.data] = (stamp.sec, stamp.nanosec)
    runs = reader.entries(["bt_agents_interfaces/msg/Run"])
    assert len(runs) == len(stamps) == 9
    for entry in runs:
        run = entry.decode()
        assert (run.header.stamp.sec, run.header.stamp.nanosec) == stamps[entry.data]
        assert run.header.frame_id == ""
        assert run.scene.header.stamp.sec > 0
    [tunings] = reader.entries(["bt_agents_interfaces/msg/Tunings"])
    assert not hasattr(tunings.decode(), "header")


def test_journals_of_before_and_of_now_are_of_one_system(tmp_path: Path) -> None:
    shutil.copy(RECORDED, tmp_path)
    morning(tmp_path / "trees").write(tmp_path / "of_now.mcap")
    recording = read([tmp_path])
    assert len(recording.rounds) == 3 + 4
    assert recording.counts["/bt_agents/auctions"] == 3 + 4


def test_the_studio_looks_back_into_a_journal_of_before() -> None:
    history = read_journal(RECORDED, mood="mood")
    assert len(history.newest("rounds")) == 3
    assert history.newest("moods")
    assert [one.label for one in history.newest("bookmarks")] == ["they laughed"]


@pytest.mark.parametrize(
    ("recorded", "kind", "name"),
    [
        ("/scene", "Scene", "/bt_agents/scene"),
        ("/scene/live", "Scene", "/bt_agents/scene/live"),
        ("/robot1/runs", "Run", "/robot1/bt_agents/runs"),
        ("/robot1/bt_agents/runs", "Run", "/robot1/bt_agents/runs"),
        ("/scene/runs", "Run", "/scene/bt_agents/runs"),
        ("/scene", "MarketStatus", "/scene"),
        ("/agents/status", "TreeStatus", "/agents/status"),
        ("/myscene", "Scene", "/myscene"),
    ],
)
def test_a_name_of_before_is_known_by_its_type(recorded: str, kind: str, name: str) -> None:
    assert present_name(recorded, f"bt_agents_interfaces/msg/{kind}") == name
