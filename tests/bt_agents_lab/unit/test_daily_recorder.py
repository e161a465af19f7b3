# SPDX-License-Identifier: Apache-2.0
"""The journal has a file for each day, says when it cannot write, and goes on when it can."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from datetime import date, timedelta
from pathlib import Path

import pytest

from bt_agents_lab.recorder import daily_recorder
from bt_agents_lab.recorder.daily_recorder import DailyRecorder
from bt_agents_lab.recorder.file import JournalFile
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.replay.recording_index import tell
from journal_fixture import said, ticks


class Desk:
    """A journal with a calendar and a disk of its own."""

    def __init__(self, folder: Path, kept: int = 0) -> None:
        self.today = date(2026, 3, 1)
        self.told: list[str] = []
        self.full = False
        self.room = 0
        self.error = errno.ENOSPC
        self.folder = folder
        self.journal = DailyRecorder(
            folder,
            days=kept,
            today=lambda: self.today,
            tell=lambda words, _wrong: self.told.append(words),
            write=self._write,
        )

    def _write(self, file: int, data: bytes, at: int) -> int:
        if self.full and len(data) > self.room:
            raise OSError(self.error, os.strerror(self.error))
        return os.pwrite(file, data, at)

    def hear(self, *numbers: int, fact: str = "", size: int = 0) -> None:
        for number in numbers:
            self.journal.take(said(number, size=size), fact=fact)

    def flush(self) -> None:
        self.journal.flush(10**9)

    def file(self, day: str) -> Path:
        return self.folder / f"journal-{day}.mcap"


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    desk = Desk(tmp_path / "journal")
    yield desk
    desk.journal.close()


def test_a_new_day_has_a_new_file_that_begins_with_what_is_still_true(desk: Desk) -> None:
    desk.hear(1, fact="a")
    desk.hear(2, fact="b")
    desk.hear(3, fact="a")
    desk.hear(4)
    desk.today += timedelta(days=1)
    desk.hear(5)
    desk.flush()
    assert sorted(ticks(desk.file("2026-03-02"))) == [2, 3, 5]
    assert ticks(desk.file("2026-03-01")) == [1, 2, 3, 4]


def test_a_day_on_which_nothing_is_said_has_a_file_too(desk: Desk) -> None:
    desk.hear(1, fact="a")
    desk.today += timedelta(days=1)
    desk.flush()
    assert ticks(desk.file("2026-03-02")) == [1]


def test_a_full_disk_is_said_once_and_nothing_is_lost_while_memory_lasts(desk: Desk) -> None:
    desk.hear(1)
    desk.flush()
    desk.full = True
    for number in range(2, 6):
        desk.hear(number)
        desk.flush()
    [words] = desk.told
    assert words.startswith("STORAGE_FULL")
    assert "No space left" in words
    desk.full = False
    desk.flush()
    assert ticks(desk.file("2026-03-01")) == [1, 2, 3, 4, 5]
    assert "goes on" in desk.told[-1]
    assert "lost" not in desk.told[-1]


def test_memory_is_bounded_and_what_is_lost_is_counted_and_found(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(daily_recorder, "MOST_WAITING", 5_000)
    desk.hear(1)
    desk.flush()
    desk.full = True
    desk.hear(*range(2, 12), size=1000)
    desk.flush()
    desk.full = False
    desk.flush()
    lost = 10 - 4
    assert f"{lost} messages are lost" in desk.told[-1]
    desk.hear(12)
    desk.flush()
    assert ticks(desk.file("2026-03-01")) == [1, 2, 3, 4, 5, 12]
    story = tell(JournalReader([desk.file("2026-03-01")]).entries())
    assert story.lost == {"/agents/status": lost}


def test_a_new_topic_on_a_full_disk_is_kept_as_soon_as_there_is_room(desk: Desk) -> None:
    desk.full = True
    desk.journal.take(said(1, topic="/new"))
    desk.full = False
    desk.journal.take(said(2, topic="/new"))
    desk.flush()
    assert ticks(desk.file("2026-03-01")) == [2]
    assert "1 messages are lost" in desk.told[-1]


def test_a_full_disk_at_midnight_keeps_the_old_file_until_there_is_room(desk: Desk) -> None:
    desk.hear(1)
    desk.full = True
    desk.today += timedelta(days=1)
    desk.hear(2)
    desk.flush()
    desk.full = False
    desk.hear(3)
    desk.flush()
    kept = ticks(desk.file("2026-03-01")) + ticks(desk.file("2026-03-02"))
    assert kept == [1, 2, 3]


def test_a_disk_with_room_for_the_head_of_a_file_only_loses_nothing_at_midnight(
    desk: Desk,
) -> None:
    desk.hear(1)
    desk.flush()
    desk.full, desk.room = True, 60
    desk.hear(2, 3, size=2000)
    desk.flush()
    desk.today += timedelta(days=1)
    desk.hear(4)
    desk.flush()
    assert not desk.file("2026-03-02").exists()
    desk.full = False
    desk.flush()
    desk.hear(5)
    desk.flush()
    assert ticks(desk.file("2026-03-01")) == [1, 2, 3, 4]
    assert ticks(desk.file("2026-03-02")) == [5]


def test_a_file_of_the_new_day_that_another_journal_writes_is_waited_for(desk: Desk) -> None:
    desk.hear(1)
    desk.flush()
    other = JournalFile(desk.file("2026-03-02"))
    desk.today += timedelta(days=1)
    desk.hear(2)
    desk.flush()
    assert "another journal writes" in " ".join(desk.told)
    other.close()
    desk.flush()
    desk.hear(3)
    desk.flush()
    assert ticks(desk.file("2026-03-01")) == [1, 2]
    assert ticks(desk.file("2026-03-02")) == [3]


def test_what_is_lost_at_the_end_is_said(tmp_path: Path) -> None:
    desk = Desk(tmp_path / "journal")
    desk.hear(1)
    desk.flush()
    desk.full = True
    desk.hear(2, 3, 4)
    desk.journal.close()
    assert "3 messages are lost" in desk.told[-1]
    assert ticks(desk.file("2026-03-01")) == [1]


@pytest.mark.parametrize("number", [errno.EIO, errno.EROFS])
def test_another_trouble_than_a_full_disk_is_not_called_one(desk: Desk, number: int) -> None:
    desk.hear(1)
    desk.flush()
    desk.full, desk.error = True, number
    desk.hear(2)
    desk.flush()
    [words] = desk.told
    assert words.startswith("STORAGE_FAILED")
    assert os.strerror(number) in words
    desk.full = False
    desk.flush()
    assert "goes on" in desk.told[-1]


def test_the_oldest_files_are_dropped_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    folder.mkdir()
    for day in range(20, 28):
        (folder / f"journal-2026-02-{day}.mcap").touch()
    (folder / "mine.mcap").touch()
    desk = Desk(folder, kept=3)
    desk.journal.close()
    left = sorted(path.name for path in folder.iterdir())
    assert left == [
        "journal-2026-02-26.mcap",
        "journal-2026-02-27.mcap",
        "journal-2026-03-01.mcap",
        "mine.mcap",
    ]
