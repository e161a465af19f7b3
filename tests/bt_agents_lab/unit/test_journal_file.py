# SPDX-License-Identifier: Apache-2.0
"""File of the journal: append-only, with readable records and definitions of its types."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.summary import Summary
from mcap_ros2._dynamic import generate_dynamic
from mcap_ros2.decoder import DecoderFactory

from bt_agents_core.errors import Refused
from bt_agents_lab.node import definition_text
from bt_agents_lab.recorder.file import JournalFile, definition
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_ros.types import types_of
from journal_fixture import recorded, ticks


def fill(file: JournalFile, first: int, last: int, *, chunk: int = 3) -> None:
    for number in range(first, last):
        file.add(recorded(number), number + 1)
        if number % chunk == chunk - 1:
            file.flush()
    file.flush()


def summary_of(path: Path) -> Summary:
    with path.open("rb") as stream:
        return make_reader(stream).get_summary()


def test_closed_file_has_standard_summary(tmp_path: Path) -> None:
    file = JournalFile(tmp_path / "a.mcap")
    fill(file, 0, 10)
    file.close()
    summary = summary_of(file.path)
    assert summary.statistics.message_count == 10
    [schema] = summary.schemas.values()
    assert b"MSG: bt_agents_interfaces/StatusChange" in schema.data
    with file.path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = [message.tick for _, _, _, message in reader.iter_decoded_messages()]
        assert found == list(range(10))
        middle = reader.iter_decoded_messages(starting_at=4_000_000_000, ending_at=6_000_000_000)
        assert [message.tick for _, _, _, message in middle] == [3, 4, 5]


def test_existing_file_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"of another start")
    with pytest.raises(FileExistsError):
        JournalFile(tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == b"of another start"


def test_flushed_messages_are_readable_from_open_file(tmp_path: Path) -> None:
    file = JournalFile(tmp_path / "a.mcap")
    for first in (0, 4, 8):
        fill(file, first, first + 4)
        reader = JournalReader([file.path])
        assert [entry.decode().tick for entry in reader.entries()] == list(range(first + 4))
        assert reader.problems == []
    file.close()


def test_truncated_file_is_readable_to_last_complete_record(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    file = JournalFile(whole)
    ends = []
    for first in (0, 3, 6):
        fill(file, first, first + 3)
        ends.append(whole.stat().st_size)
    file.close()
    content = whole.read_bytes()
    torn = tmp_path / "a.mcap"
    for cut in [*range(0, len(content), 37), *(end + d for end in ends for d in (-1, 0, 1))]:
        torn.write_bytes(content[:cut])
        found = ticks(torn)
        assert found == list(range(len(found)))
        assert len(found) >= 3 * sum(cut >= end for end in ends)


def rotten(path: Path, part: int) -> bytes:
    """Return the bytes of a journal of three parts, one of which does not match its checksum."""
    file = JournalFile(path)
    fill(file, 0, 9)
    file.close()
    content = bytearray(path.read_bytes())
    chunk = summary_of(path).chunk_indexes[part]
    content[chunk.chunk_start_offset + chunk.chunk_length - 20] ^= 0xFF
    return bytes(content)


@pytest.mark.parametrize("part", [0, 1, 2])
def test_corrupt_chunk_loses_only_its_own_messages(tmp_path: Path, part: int) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(rotten(path, part))
    reader = JournalReader([path])
    left = [number for number in range(9) if number // 3 != part]
    assert [entry.decode().tick for entry in reader.entries()] == left
    [problem] = reader.problems
    assert "cannot be read" in problem


def test_messages_of_undeclared_topic_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    content = rotten(path, 0)
    # Killed: it has its parts, but no summary.
    path.write_bytes(content[: summary_of(path).chunk_indexes[2].chunk_start_offset])
    reader = JournalReader([path])
    assert reader.entries() == []
    assert "cannot be read" in reader.problems[0]
    assert "3 messages of unreadable topics" in reader.problems[1]


def test_failed_partial_write_leaves_file_unchanged(tmp_path: Path) -> None:
    room = 10**9

    def write(file: int, data: bytes, at: int) -> int:
        nonlocal room
        if room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        done = os.pwrite(file, data[: max(1, min(len(data), room))], at)
        room -= done
        return done

    file = JournalFile(tmp_path / "a.mcap", write)
    fill(file, 0, 3)
    size = file.path.stat().st_size
    room = 40
    with pytest.raises(OSError, match="No space"):
        fill(file, 3, 6)
    assert file.path.stat().st_size == size
    assert file.waiting == 3
    room = 10**9
    file.flush()
    file.close()
    assert ticks(file.path) == list(range(6))


# --- definitions of types ---------------------------------------------------------------------

TYPES = {
    "a/msg/Top": "b/Part part\nLeaf[] leaves  # of a\nb/msg/Part[<=3] more\nuint8 X=1\nstring s",
    "a/msg/Leaf": "float64 value\nwstring w\nuint8[16] id",
    "b/msg/Part": "Inner inner\nstring<=10 short",
    "b/msg/Inner": "bool x",
}


def test_nested_types_follow_their_type_once() -> None:
    text = definition("a/msg/Top", TYPES.get)
    heads = [line for line in text.splitlines() if line.startswith("MSG: ")]
    assert heads == ["MSG: b/Part", "MSG: a/Leaf", "MSG: b/Inner"]
    assert text.startswith("b/Part part\n")
    assert text.count("=" * 80) == 3


def test_type_without_definition_is_reported() -> None:
    with pytest.raises(Refused, match="no definition of b/msg/Part, which a/msg/Top needs"):
        definition("a/msg/Top", {"a/msg/Top": "b/Part part"}.get)


@pytest.mark.parametrize("name", [t for t in types_of("bt_agents_interfaces") if "msg/" in t])
def test_every_own_message_decodes_from_its_definition(name: str) -> None:
    text = definition(f"bt_agents_interfaces/{name}", definition_text)
    assert f"bt_agents_interfaces/{name}" in generate_dynamic(f"bt_agents_interfaces/{name}", text)
