# SPDX-License-Identifier: Apache-2.0
"""Bags of ``ros2 bag record``: read like journals, with remarks about missing data."""

from __future__ import annotations

import json
import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard
from click.testing import CliRunner
from mcap.data_stream import RecordBuilder
from mcap.records import Header, Schema
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from bag_fixture import write_bag
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Bookmark
from bt_agents_lab.cli.journal import journal
from bt_agents_lab.cli.replay import replay
from bt_agents_lab.cli.what_if import what_if
from bt_agents_lab.recorder import reading
from bt_agents_lab.recorder.bag import recorded_files
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.replay.decisions import replay_decisions
from bt_agents_lab.replay.findings import ReplayVerdict
from bt_agents_lab.replay.recording_index import read
from bt_agents_lab.replay.replay_learning import replay_feedback
from bt_agents_studio.recordings import Recordings
from bt_agents_studio.studio import Studio
from bt_agents_tools.cli.main import bt_agents
from command_results import split_runner
from journal_fixture import JournaledSystem, PublishedMessage
from studio_harness import SPACE


@pytest.fixture
def bag(journaled: JournaledSystem, tmp_path: Path) -> Path:
    """Return a bag of all messages in one file."""
    return write_bag(tmp_path / "morning", journaled.published)


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"files": 3, "chunks": CompressionType.ZSTD},
        {"files": 2, "packed": True},
        {"use_chunking": False, "packed": True},
        {"is_sent_known": False},
        {"namespace": "/robot1"},
    ],
    ids=["plain", "split and zstd", "zstd files", "fastwrite", "no send times", "namespace"],
)
def test_whole_bag_is_replayed(journaled: JournaledSystem, tmp_path: Path, how: dict[str, object]):
    bag = write_bag(tmp_path / "morning", journaled.published, **how)
    result = CliRunner().invoke(replay, [str(bag)])
    assert result.exit_code == 0, result.output
    assert "decisions                   4             0             0" in result.output
    # Rosbag2 does not record which messages it missed.
    assert "does not tell which messages its recorder has missed" in result.output
    assert "all that was recorded is equal" in result.output
    assert "everything is equal" not in result.output


def test_every_journal_command_reads_bags(journaled: JournaledSystem, tmp_path: Path) -> None:
    marked = PublishedMessage(topic="/bt_agents/bookmarks", message=Bookmark(label="they laughed"))
    messages = [*journaled.published, marked]
    bag = write_bag(tmp_path / "morning", messages, files=2, packed=True)
    shown = CliRunner().invoke(journal, [str(bag), "--out", str(tmp_path / "rounds.csv")]).output
    count = f"{len(messages)} messages"
    told = ("morning_0.mcap.zstd", "morning_1.mcap.zstd", count, "bert wins", "they laughed")
    assert [text for text in told if text not in shown] == []
    assert len((tmp_path / "rounds.csv").read_text().splitlines()) == 1 + 4 + 8 + 4
    outlook = CliRunner().invoke(what_if, [str(bag), "--learning-rate", "0.5"])
    assert "4 rounds" in outlook.output
    reasons = split_runner().invoke(bt_agents, ["why", "--journal", str(bag), "4"])
    assert reasons.stdout.startswith("round 4: bert")


def test_messages_of_two_recorders_are_read_once(journaled: JournaledSystem, bag: Path) -> None:
    other = shutil.copytree(bag, bag.with_name("other"))
    assert len(JournalReader([bag, other]).entries()) == len(journaled.published)


def test_missing_message_is_no_difference(journaled: JournaledSystem, tmp_path: Path) -> None:
    for place in range(15):
        rest = [*journaled.published[:place], *journaled.published[place + 1 :]]
        recording = read([write_bag(tmp_path / str(place), rest)])
        found = [*replay_decisions(recording.rounds), *replay_feedback(recording.feedbacks)]
        assert not [each for each in found if each.verdict is ReplayVerdict.DIFFERENT]


def test_two_systems_in_one_bag_need_a_namespace(
    journaled: JournaledSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = JournaledSystem(tmp_path / "trees")
    both = [
        PublishedMessage(topic=f"/robot{number}{one.topic}", message=one.message)
        for number, system in ((1, journaled), (2, other))
        for one in system.published
    ]
    bag = write_bag(tmp_path / "both", both)
    with pytest.raises(Refused, match=r"SEVERAL_SYSTEMS.* /robot1 and /robot2 .*ROS_NAMESPACE"):
        JournalReader([bag]).entries()
    monkeypatch.setenv("ROS_NAMESPACE", "robot1")
    result = CliRunner().invoke(replay, [str(bag), "--json"])
    data = json.loads(result.output)
    assert data["counts"]["decisions"] == {"equal": 4, "different": 0, "not recorded": 0}
    assert data["findings"] == []
    assert "namespaces /robot1 and /robot2, this is the one in /robot1" in result.output
    assert len(read([bag], "/robot2").rounds) == 0
    assert read([bag], "/robot2").counts["/robot1/bt_agents/auctions"] == 4


def test_missing_bag_file_is_reported(journaled: JournaledSystem, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "morning", journaled.published, files=5)
    (bag / "morning_2.mcap").unlink()
    result = CliRunner().invoke(replay, [str(bag)])
    assert result.exit_code == 2
    assert "lacks 'morning_2.mcap', which its metadata names; copy the whole" in result.output
    assert "is said to hold 32 messages, found 25" in result.output


def test_missing_definition_is_reported(journaled: JournaledSystem, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "morning", journaled.published, definitions=False)
    why = "its recorder has not found the definition of bt_agents_interfaces/msg/"
    assert why in read([bag]).problems[0]


def test_killed_recorders_bag_needs_no_metadata(journaled: JournaledSystem, bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    [file] = bag.iterdir()
    file.write_bytes(file.read_bytes()[:-40])
    assert len(JournalReader([bag]).entries()) == len(journaled.published)


@pytest.mark.parametrize("name", ["morning_0.db3", "morning_0.db3.zstd"])
def test_sqlite_bag_is_rejected_with_conversion_command(tmp_path: Path, name: str) -> None:
    bag = tmp_path / "morning"
    bag.mkdir()
    (bag / name).write_bytes(b"SQLite format 3\0")
    for path in (bag, bag / name):
        with pytest.raises(Refused, match=f"ros2 bag convert -i {bag} -o out.yaml") as refused:
            JournalReader([path])
        assert refused.value.code == "SQLITE_BAG"
    (bag / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  storage_identifier: sqlite3\n"
        f"  relative_file_paths: [{name}]\n"
    )
    with pytest.raises(Refused, match="storage_id: mcap, all_topics: true"):
        JournalReader([bag])


def test_folder_without_recording_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="NO_RECORDING: there is no journal and no bag"):
        JournalReader([tmp_path])


SPOILT: dict[str, Callable[[str], str]] = {
    "no YAML": lambda text: text.replace(": ", ":{", 1),
    "nested": lambda _: "[" * 100_000,
    "anchors": lambda _: (
        "x0: &x0 [1]\n"
        + "".join(f"x{n}: &x{n} [{', '.join([f'*x{n - 1}'] * 9)}]\n" for n in range(1, 30))
    ),
    "too large": lambda text: text + "#" * 2_000_000,
    "without files": lambda text: text.replace("relative_file_paths", "files_of_others"),
    "other folders": lambda text: text.replace("morning_0.mcap", "../../../secret.mcap"),
}


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_broken_metadata_is_reported_and_loses_no_message(
    journaled: JournaledSystem, bag: Path, spoil: Callable[[str], str]
) -> None:
    metadata = bag / "metadata.yaml"
    metadata.write_text(spoil(metadata.read_text()))
    (bag.parent / "secret.mcap").write_bytes(b"nobody asked for it")
    reader = JournalReader([bag])
    assert len(reader.entries()) == len(journaled.published)
    assert reader.files == [bag / "morning_0.mcap"]
    assert str(bag) in reader.problems[0]


def test_invalid_message_count_is_unknown(bag: Path) -> None:
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("count: 32", f"count: {'9' * 5000}"))
    assert recorded_files(bag).messages is None


def test_truncated_packed_file_is_read(journaled: JournaledSystem, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "morning", journaled.published, packed=True, use_chunking=False)
    file = bag / "morning_0.mcap.zstd"
    whole = file.read_bytes()
    for cut in range(0, len(whole), 199):
        file.write_bytes(whole[:cut])
        reader = JournalReader([file])
        assert len(reader.entries()) <= len(journaled.published)
        assert reader.problems


def packed(*parts: bytes) -> bytes:
    """Return a packed file with a header and some more bytes."""
    builder = RecordBuilder()
    Header(profile="ros2", library="libmcap 1.1.0").write(builder)
    return zstandard.compress(b"".join((MCAP0_MAGIC, builder.end(), *parts)))


def record(opcode: int, length: int, there: int = 0) -> bytes:
    """Return the header of a record of some length, followed by ``there`` zero bytes."""
    return bytes([opcode]) + length.to_bytes(8, "little") + bytes(there)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (lambda: zstandard.compress(bytes(1000)), "is not MCAP"),
        (lambda: b"no zstd at all", "only"),
        (lambda: packed(record(6, 2**60)), "unpack it with 'zstd -d'"),
        (lambda: packed(record(6, 2**26 + 1, 2**26 + 1)), "unpack it with 'zstd -d'"),
        (lambda: packed(record(10, 0)), "is torn"),
        (lambda: packed(record(10, 2**20, 2**20)), "is torn"),
    ],
    ids=["other content", "no zstd", "endless record", "large record", "empty record", "other"],
)
def test_decompression_bomb_is_not_unpacked_at_once(
    tmp_path: Path, content: Callable[[], bytes], why: str
) -> None:
    path = tmp_path / "a.mcap.zstd"
    path.write_bytes(content())
    tracemalloc.start()
    reader = JournalReader([path])
    assert reader.entries() == []
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 10_000_000
    assert why in reader.problems[0]


def test_compressed_file_is_read_up_to_size_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    builder = RecordBuilder()
    Schema(id=1, name="a/msg/B", encoding="ros2msg", data=bytes(1000)).write(builder)
    path = tmp_path / "a.mcap.zstd"
    path.write_bytes(packed(builder.end() * 100))
    monkeypatch.setattr(reading, "MOST_UNPACKED_FILE", 50_000)
    reader = JournalReader([path])
    reader.entries()
    assert "holds more than 50000 bytes" in reader.problems[0]


def test_studio_shows_bag_beside_journals(journaled: JournaledSystem, tmp_path: Path) -> None:
    journaled.write(tmp_path / "journal-2026-05-04_001.mcap")
    write_bag(tmp_path / "rosbag2_2026", journaled.published, files=2)
    (tmp_path / "notes").mkdir()
    studio = Studio("studio", space=SPACE, journal=tmp_path)
    shown = {one.name: one.bytes for one in studio.journal_list()}
    assert list(shown) == ["rosbag2_2026", "journal-2026-05-04_001.mcap"]
    recordings = Recordings(studio.mood)
    of_bag, of_journal = (
        json.loads(recordings.moment(tmp_path / name, 2.0**40).entries)["rounds"] for name in shown
    )
    assert of_bag == of_journal
    assert len(of_bag) == 4


def test_topic_of_another_program_is_no_second_system(
    journaled: JournaledSystem, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "morning", journaled.published, namespace="/robot1")
    other = tmp_path / "chat.mcap"
    with other.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/chat/answers", "cdr", schema)
        writer.add_message(channel, log_time=1, data=b"", publish_time=1)
        writer.finish()
    assert len(JournalReader([bag, other]).entries()) == len(journaled.published) + 1
