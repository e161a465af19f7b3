# SPDX-License-Identifier: Apache-2.0
"""Daily files of the journal: one per start and day, and recovery from a full disk."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator
from datetime import date, timedelta
from pathlib import Path

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.health import Health
from bt_agents_lab.recorder import daily_recorder
from bt_agents_lab.recorder.daily_recorder import DailyRecorder, newest_files
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.replay.recording_index import index_entries
from journal_fixture import recorded, ticks


class Recorder:
    """A journal with a fake calendar and disk."""

    def __init__(self, folder: Path, kept: int = 0) -> None:
        self.today = date(2026, 3, 1)
        self.reports: list[str] = []
        self.full = False
        self.room = 0
        self.error = errno.ENOSPC
        self.folder = folder
        self.journal = DailyRecorder(
            folder,
            days=kept,
            today=lambda: self.today,
            report=lambda text, _is_error: self.reports.append(text),
            write=self._write,
        )

    def _write(self, file: int, data: bytes, at: int) -> int:
        if self.full and len(data) > self.room:
            raise OSError(self.error, os.strerror(self.error))
        return os.pwrite(file, data, at)

    def receive(self, *numbers: int, fact: str = "", size: int = 0) -> None:
        for number in numbers:
            self.journal.record(recorded(number, tip="x" * size), fact=fact)

    def flush(self) -> None:
        self.journal.flush(10**9)

    def keep(self, *numbers: int, size: int = 0) -> None:
        """Receive messages, and try to write them."""
        self.receive(*numbers, size=size)
        self.flush()

    def file(self, day: str, start: int = 1) -> Path:
        return self.folder / f"journal-{day}_{start:03}.mcap"


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    recorder = Recorder(tmp_path / "journal")
    yield recorder
    recorder.journal.close()


def test_new_day_file_begins_with_current_facts(recorder: Recorder) -> None:
    recorder.receive(1, fact="a")
    recorder.receive(2, fact="b")
    recorder.receive(3, fact="a")
    recorder.receive(4)
    recorder.today += timedelta(days=1)
    recorder.keep(5)
    assert sorted(ticks(recorder.file("2026-03-02"))) == [2, 3, 5]
    assert ticks(recorder.file("2026-03-01")) == [1, 2, 3, 4]


def test_quiet_day_has_a_file_too(recorder: Recorder) -> None:
    recorder.receive(1, fact="a")
    recorder.today += timedelta(days=1)
    recorder.flush()
    assert ticks(recorder.file("2026-03-02")) == [1]


def test_full_disk_is_reported_once_and_messages_buffered(recorder: Recorder) -> None:
    recorder.keep(1)
    recorder.full = True
    for number in range(2, 6):
        recorder.keep(number)
    [text] = recorder.reports
    assert re.match("STORAGE_FULL.*No space left", text)
    health = recorder.journal.health
    failure = "journal-2026-03-01_001.mcap cannot be written: No space left on device"
    assert (health.level, health.message) == (Health.ERROR, failure)
    recorder.full = False
    recorder.flush()
    assert ticks(recorder.file("2026-03-01")) == [1, 2, 3, 4, 5]
    assert ["goes on" in recorder.reports[-1], "lost" in recorder.reports[-1]] == [True, False]
    assert recorder.journal.health.message == "everything is recorded"


def test_buffer_is_bounded_and_lost_messages_are_counted(
    recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(daily_recorder, "MOST_WAITING", 5_000)
    recorder.keep(1)
    recorder.full = True
    recorder.keep(*range(2, 12), size=1000)
    lost = 10 - 4
    assert recorder.journal.health.values["dropped"] == str(lost)
    recorder.full = False
    recorder.flush()
    assert f"{lost} messages are lost" in recorder.reports[-1]
    recorder.keep(12)
    assert ticks(recorder.file("2026-03-01")) == [1, 2, 3, 4, 5, 12]
    recording = index_entries(JournalReader([recorder.file("2026-03-01")]).entries())
    assert recording.lost == {"/agents/status": lost}


def test_new_topic_on_full_disk_at_midnight_loses_nothing(recorder: Recorder) -> None:
    recorder.receive(1)
    recorder.full = True
    recorder.today += timedelta(days=1)
    recorder.journal.record(recorded(2, topic="/new"))
    recorder.flush()
    recorder.full = False
    recorder.journal.record(recorded(3, topic="/new"))
    recorder.flush()
    kept = ticks(recorder.file("2026-03-01")) + ticks(recorder.file("2026-03-02"))
    assert kept == [1, 2, 3]
    assert "lost" not in recorder.reports[-1]


def test_room_for_file_head_only_loses_nothing(recorder: Recorder) -> None:
    recorder.keep(1)
    recorder.full, recorder.room = True, 60
    recorder.keep(2, 3, size=2000)
    recorder.today += timedelta(days=1)
    recorder.keep(4)
    assert not recorder.file("2026-03-02").exists()
    recorder.full = False
    recorder.flush()
    recorder.keep(5)
    assert ticks(recorder.file("2026-03-01")) == [1, 2, 3, 4]
    assert ticks(recorder.file("2026-03-02")) == [5]


def test_failed_day_file_is_created_later_without_gap(recorder: Recorder) -> None:
    recorder.keep(1)
    recorder.full = True
    recorder.today += timedelta(days=1)
    recorder.flush()
    recorder.flush()
    assert [path.name for path in recorder.folder.iterdir()] == [recorder.file("2026-03-01").name]
    recorder.full = False
    recorder.keep(2)
    recorder.keep(3)
    assert ticks(recorder.file("2026-03-01")) == [1, 2]
    assert ticks(recorder.file("2026-03-02")) == [3]


def test_each_start_creates_its_own_file(tmp_path: Path) -> None:
    for start in (1, 2, 3):
        recorder = Recorder(tmp_path)
        recorder.receive(start)
        recorder.journal.close()
    recorder = Recorder(tmp_path)
    recorder.today += timedelta(days=1)
    recorder.flush()
    recorder.journal.close()
    starts = [recorder.file("2026-03-01", start) for start in (1, 2, 3, 4)]
    assert list(map(ticks, starts)) == [[1], [2], [3], []]
    assert newest_files(tmp_path) == [recorder.file("2026-03-02")]
    recorder.file("2026-03-02").unlink()
    assert newest_files(tmp_path) == starts


def test_two_journals_never_share_a_folder(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    with pytest.raises(Refused, match="another journal"):
        Recorder(tmp_path)
    recorder.journal.close()
    health = recorder.journal.health
    assert (health.level, health.message) == (Health.OK, "the recording is stopped")
    Recorder(tmp_path).journal.close()


def test_messages_lost_at_close_are_reported(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "journal")
    recorder.keep(1)
    recorder.full = True
    recorder.receive(2, 3, 4)
    recorder.journal.close()
    assert "3 messages are lost" in recorder.reports[-1]
    assert ticks(recorder.file("2026-03-01")) == [1]


@pytest.mark.parametrize("number", [errno.EIO, errno.EROFS])
def test_other_storage_error_is_not_called_full_disk(recorder: Recorder, number: int) -> None:
    recorder.keep(1)
    recorder.full, recorder.error = True, number
    recorder.keep(2)
    [text] = recorder.reports
    assert re.match(f"STORAGE_FAILED.*{os.strerror(number)}", text)
    recorder.full = False
    recorder.flush()
    assert "goes on" in recorder.reports[-1]


def test_only_files_of_oldest_days_are_deleted(tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    folder.mkdir()
    starts = [f"2026-02-{day}_00{start}" for day in range(20, 28) for start in (1, 2)]
    names = [f"journal-{start}.mcap" for start in (*starts, "2026-02-26", "2026-01-01")]
    for name in (*names, "mine.mcap"):
        (folder / name).touch()
    Recorder(folder, kept=3).journal.close()
    left = {path.name for path in folder.iterdir()}
    kept = ("2026-02-26", *starts[-4:], "2026-03-01_001")
    assert left == {*(f"journal-{start}.mcap" for start in kept), "mine.mcap"}
