# SPDX-License-Identifier: Apache-2.0
"""A file of the journal is only ever added to, and keeps every whole record."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Message
from mcap_ros2.decoder import DecoderFactory

from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import TreeStatus
from bt_agents_lab.recorder.file import JournalFile
from bt_agents_lab.recorder.reading import JournalReader
from journal_fixture import said, ticks, topic_of


def fill(file: JournalFile, first: int, last: int, *, chunk: int = 3) -> None:
    topic = topic_of(TreeStatus, "/agents/status")
    channel = file.channel(topic.name, topic.type, topic.definition)
    for number in range(first, last):
        one = said(number)
        file.add(
            Message(
                channel_id=channel,
                log_time=one.heard_ns,
                publish_time=one.sent_ns,
                sequence=number + 1,
                data=one.data,
            )
        )
        if number % chunk == chunk - 1:
            file.flush()
    file.flush()


def torn_by_a_kill(file: JournalFile) -> None:
    os.close(file._file)


def test_a_closed_file_has_a_summary_that_any_reader_finds(tmp_path: Path) -> None:
    file = JournalFile(tmp_path / "a.mcap")
    fill(file, 0, 10)
    file.close()
    with file.path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 10
        [schema] = summary.schemas.values()
        assert b"MSG: bt_agents_interfaces/StatusChange" in schema.data
        found = [message.tick for _, _, _, message in reader.iter_decoded_messages()]
        assert found == list(range(10))
        middle = reader.iter_decoded_messages(starting_at=4_000_000_000, ending_at=6_000_000_000)
        assert [message.tick for _, _, _, message in middle] == [3, 4, 5]


def test_the_next_start_of_the_same_day_goes_on_in_the_same_file(tmp_path: Path) -> None:
    for start in range(3):
        file = JournalFile(tmp_path / "a.mcap")
        fill(file, 4 * start, 4 * start + 4)
        if start == 1:
            torn_by_a_kill(file)
        else:
            file.close()
    assert ticks(tmp_path / "a.mcap") == list(range(12))
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
    with file.path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 12
    assert len(summary.channels) == len(summary.schemas) == 1


def test_a_file_cut_anywhere_keeps_all_whole_records_and_every_byte(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    file = JournalFile(whole)
    ends = []
    for first in (0, 3, 6):
        fill(file, first, first + 3)
        ends.append(whole.stat().st_size)
    file.close()
    content = whole.read_bytes()
    for cut in [*range(0, len(content), 37), *(end + d for end in ends for d in (-1, 0, 1))]:
        folder = tmp_path / str(cut)
        folder.mkdir(exist_ok=True)
        torn = folder / "a.mcap"
        torn.write_bytes(content[:cut])
        again = JournalFile(torn)
        fill(again, 9, 11)
        again.close()
        chunks = [i for i, end in enumerate(ends) if cut >= end]
        least = 3 * len(chunks)
        found = ticks(torn)
        assert found[-2:] == [9, 10]
        assert found[:-2] == list(range(len(found) - 2))
        assert len(found) - 2 >= least
        if again.aside is not None:
            # Whatever was cut off is still there to be looked at.
            assert content[:cut].endswith(again.aside.read_bytes())


def test_bytes_that_cannot_be_read_are_put_aside_again_and_again(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    for number in (1, 2):
        path.write_bytes(b"this is no journal")
        file = JournalFile(path)
        assert file.aside == tmp_path / f"a.mcap.torn-{number}"
        assert file.aside.read_bytes() == b"this is no journal"
        file.close()
    assert ticks(path) == []


def test_a_part_that_rots_costs_that_part_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    file = JournalFile(path)
    fill(file, 0, 9)
    start = file._contents.chunks[1].chunk_start_offset
    length = file._contents.chunks[1].chunk_length
    file.close()
    content = bytearray(path.read_bytes())
    content[start + length - 20] ^= 0xFF
    path.write_bytes(content)
    reader = JournalReader([path])
    assert [entry.decode().tick for entry in reader.entries()] == [0, 1, 2, 6, 7, 8]
    assert "cannot be read" in reader.problems[0]


def test_two_journals_never_write_one_file(tmp_path: Path) -> None:
    file = JournalFile(tmp_path / "a.mcap")
    with pytest.raises(Refused, match="another journal"):
        JournalFile(tmp_path / "a.mcap")
    file.close()
    JournalFile(tmp_path / "a.mcap").close()


def test_a_write_that_fails_half_way_leaves_the_file_as_it_was(tmp_path: Path) -> None:
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
    assert len(file.waiting) == 3
    room = 10**9
    file.flush()
    file.close()
    assert ticks(file.path) == list(range(6))


def test_what_is_there_twice_is_read_once(tmp_path: Path) -> None:
    file = JournalFile(tmp_path / "a.mcap")
    fill(file, 0, 3)
    fill(file, 0, 3)
    file.close()
    assert ticks(file.path) == [0, 1, 2]
