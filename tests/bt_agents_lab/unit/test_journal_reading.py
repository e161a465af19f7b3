# SPDX-License-Identifier: Apache-2.0
"""Reading of journals: during writing, with torn files, and only the requested topics."""

from __future__ import annotations

import re
import subprocess
import sys
import tracemalloc
from io import BytesIO
from pathlib import Path
from random import Random

import pytest
import zstandard
from click.testing import CliRunner
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, Footer, Header, McapRecord
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from rclpy.serialization import serialize_message

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_interfaces.msg import Bookmark, Scene
from bt_agents_lab.cli.journal import journal
from bt_agents_lab.cli.replay import replay
from bt_agents_lab.cli.what_if import what_if
from bt_agents_lab.recorder import reading
from bt_agents_lab.recorder.file import LIBRARY, JournalFile, RecordedMessage
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.replay.recording_index import read
from journal_fixture import add_messages, morning, topic_of

BOOKMARK = "bt_agents_interfaces/msg/Bookmark"


def begun(path: Path, *, bookmarks: int = 1, scenes: int = 0) -> JournalFile:
    """Return a journal that is still being written, with messages of two topics."""
    file = JournalFile(path)
    add_messages(file, Bookmark(), "/bookmarks", range(1, bookmarks + 1))
    add_messages(file, Scene(), "/bt_agents/scene/live", range(1, scenes + 1))
    return file


def written(*records: McapRecord, library: str = LIBRARY) -> bytes:
    """Return a file of a writer with some records after the header."""
    builder = RecordBuilder()
    for record in (Header(profile="ros2", library=library), *records):
        record.write(builder)
    return MCAP0_MAGIC + bytes(builder.end())


def test_growing_file_is_read_on_from_last_record(tmp_path: Path) -> None:
    file = begun(tmp_path / "a.mcap")
    reader = JournalReader([file.path])
    assert len(reader.further_entries()) == 1
    assert reader.further_entries() == []
    before = file.path.stat().st_size
    add_messages(file, Bookmark(label="more"), "/bookmarks", range(2, 4))
    whole = file.path.read_bytes()
    # The new part is read without the earlier ones, and partly left for later.
    copy = tmp_path / "b.mcap"
    copy.write_bytes(whole[:before])
    reader = JournalReader([copy])
    assert len(reader.further_entries()) == 1
    copy.write_bytes(bytes(before) + whole[before : before + 20])
    assert reader.further_entries() == []
    copy.write_bytes(bytes(before) + whole[before:])
    assert [one.decode().label for one in reader.further_entries()] == ["more", "more"]
    file.close()


def test_clock_set_back_keeps_order_of_messages(tmp_path: Path) -> None:
    file = JournalFile(tmp_path / "a.mcap")
    # A latched message that was sent before the clock was set back is received once more.
    times = (("a", 50, 50), ("b", 60, 60), ("c", 10, 10), ("latched", 58, 11), ("d", 20, 20))
    for number, (label, sent_s, received_s) in enumerate(times, 1):
        message = RecordedMessage(
            topic=topic_of(Bookmark, "/bookmarks"),
            data=serialize_message(Bookmark(label=label)),
            sent_ns=sent_s * 10**9,
            received_ns=received_s * 10**9,
        )
        file.add(message, number)
    file.close()
    found = [one.decode().label for one in JournalReader([file.path]).entries()]
    assert found == [label for label, _, _ in times]


def test_piece_counts_any_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "MOST_FURTHER", 2)
    file = begun(tmp_path / "a.mcap", scenes=4)
    reader = JournalReader([file.path])
    found = []
    while not reader.is_at_end:
        found.append(len(reader.further_entries({BOOKMARK})))
    file.close()
    assert (sum(found), len(found)) == (1, 3)


def test_file_ending_inside_record_is_reported(tmp_path: Path) -> None:
    file = begun(tmp_path / "a.mcap")
    whole = file.path.read_bytes()
    for torn in (b"\x05", whole[-9:-1], b"\x06" + (500).to_bytes(8, "little") + bytes(20)):
        file.path.write_bytes(whole + torn)
        reader = JournalReader([file.path])
        assert len(reader.entries()) == 1
        [text] = reader.problems
        assert "in the middle of a record, as after a kill" in text or "only" in text
        assert "EndOfFile" not in text
    file.close()


def test_unrequested_messages_are_counted_and_not_kept(tmp_path: Path) -> None:
    file = begun(tmp_path / "a.mcap", bookmarks=2, scenes=20_000)
    file.close()
    reader = JournalReader([file.path])
    tracemalloc.start()
    [first, _] = reader.entries({BOOKMARK})
    left, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert first.type == BOOKMARK
    assert left < 500_000
    counted = reader.counted["/bt_agents/scene/live"]
    assert (counted.messages, counted.first_ns, counted.last_ns) == (20_000, 1, 20_000)
    recording = read([file.path])
    assert recording.counts == {"/bookmarks": 2, "/bt_agents/scene/live": 20_000}
    assert (recording.first_ns, recording.last_ns) == (1, 20_000)


@pytest.mark.parametrize("library", ["bt-agents", "bt-agents journal 2", "bt-agents journal 4"])
def test_journal_of_another_format_is_rejected(tmp_path: Path, library: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(written(library=library))
    with pytest.raises(Refused, match=rf"OTHER_FORMAT.*'{library}'.*'{LIBRARY}'"):
        JournalReader([path]).entries()


def chunk(data: bytes, said: int, compression: str = "zstd") -> Chunk:
    """Return a chunk of some bytes, whose header states another size."""
    return Chunk(
        compression=compression,
        data=zstandard.compress(data),
        message_start_time=0,
        message_end_time=0,
        uncompressed_crc=0,
        uncompressed_size=said,
    )


@pytest.mark.parametrize("said", [100, 200_000_000])
def test_decompression_bomb_is_not_unpacked(tmp_path: Path, said: int) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(written(chunk(bytes(200_000_000), said)))
    tracemalloc.start()
    reader = JournalReader([path])
    assert reader.entries() == []
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 10_000_000
    assert "said to" in reader.problems[0]


def test_unknown_compression_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(written(chunk(b"", 0, "lz4")))
    reader = JournalReader([path])
    assert reader.entries() == []
    assert "compressed by lz4, expected zstd" in reader.problems[0]


WITHOUT_LAB = """
import sys
sys.modules.update(dict.fromkeys(("mcap", "mcap_ros2", "pyarrow", "zstandard")))
from bt_agents_tools.cli.main import main
sys.argv = ["bt-agents", *sys.argv[1:]]
main()
"""


def python(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_help_without_lab_packages_states_the_requirement() -> None:
    done = python(WITHOUT_LAB, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(r"^  replay +\w", done.stdout, re.MULTILINE)
    told = python(WITHOUT_LAB, "replay", "-h").stdout
    assert "pip install mcap-ros2-support" in " ".join(told.split())


def test_missing_package_is_reported() -> None:
    done = python(WITHOUT_LAB, "replay", "a.mcap", "--json")
    assert done.returncode == 1
    assert done.stderr.startswith("error: this command needs the package mcap; install it with")
    assert "pip install 'bt-agents[lab]'" in done.stderr


def test_journal_node_without_packages_ends_with_message() -> None:
    done = python(
        "import sys; sys.modules['mcap'] = None\n"
        "from bt_agents_lab import run_journal\n"
        "sys.exit(run_journal())"
    )
    assert done.returncode == 1
    assert done.stderr == (
        "error: a journal needs the package mcap; install it with pip install 'bt-agents[lab]', "
        "or beside a workspace of colcon with pip install mcap-ros2-support\n"
    )


def test_commands_report_flipped_bits_with_a_message(tmp_path: Path) -> None:
    whole = morning(tmp_path / "trees").write(tmp_path / "a.mcap").read_bytes()
    random = Random(4)
    path = tmp_path / "b.mcap"
    ends = set()
    # No checksum covers the headers of records.
    for place in [random.randrange(len(whole) // 2) for _ in range(25)]:
        broken = bytearray(whole)
        broken[place] ^= 1 << random.randrange(8)
        path.write_bytes(broken)
        for command in (replay, journal, what_if):
            result = CliRunner().invoke(command, [str(path)])
            assert isinstance(result.exception, (type(None), SystemExit, BtAgentsError)), place
            ends.add(result.exit_code)
    assert 0 in ends


def test_torn_journal_is_never_reported_as_fully_equal(tmp_path: Path) -> None:
    path = morning(tmp_path / "trees").write(tmp_path / "a.mcap")
    content = path.read_bytes()
    [footer] = [one for one in StreamReader(BytesIO(content)).records if isinstance(one, Footer)]
    # Where the record before the summary begins.
    end = footer.summary_start - 13
    path.write_bytes(content[: end + 5])
    result = CliRunner().invoke(replay, [str(path)])
    assert result.exit_code == 2
    assert "all that could be read is equal" in result.output
    path.write_bytes(content[:end])
    result = CliRunner().invoke(replay, [str(path)])
    assert result.exit_code == 0
    assert "everything is equal" in result.output
