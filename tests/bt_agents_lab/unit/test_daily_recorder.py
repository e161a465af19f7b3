# SPDX-License-Identifier: Apache-2.0
"""The recorder: a file per start and day, a full disk, and recordings by hand."""

from __future__ import annotations

import errno
import math
import os
import re
from collections.abc import Callable, Iterator
from datetime import date, timedelta
from pathlib import Path

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.health import Health
from bt_agents_lab.recorder import daily_recorder, recording_control
from bt_agents_lab.recorder.daily_recorder import DailyRecorder, lock_folder, newest_files
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.recorder.recording_control import MarkedMoment, RecordingControl, RecordingState
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


def test_full_disk_at_midnight_loses_no_new_topic(recorder: Recorder) -> None:
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


def test_other_storage_error_is_not_called_full_disk(recorder: Recorder) -> None:
    recorder.keep(1)
    recorder.full, recorder.error = True, errno.EIO
    recorder.keep(2)
    [text] = recorder.reports
    assert re.match("STORAGE_FAILED.*Input/output error", text)
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


def test_wrong_later_dates_never_delete_todays_file(tmp_path: Path) -> None:
    (tmp_path / "journal-2036-01-01_001.mcap").touch()
    (tmp_path / "journal-2026-02-28_001.mcap").touch()
    recorder = Recorder(tmp_path, kept=1)
    assert recorder.journal.path.exists()
    recorder.journal.close()
    assert [path.name for path in tmp_path.iterdir()] == ["journal-2026-03-01_001.mcap"]


# --- recordings by hand -----------------------------------------------------------------------


class Recording(Recorder):
    """A recorder with its control and its published states."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.states: list[RecordingState] = []
        self.bookmarks: list[MarkedMoment] = []
        self.now_ns = 10**9
        self.set_back_s = 0.0
        self.control = RecordingControl(
            self.journal, self, lambda: self.now_ns, lambda: self.now_ns * 1e-9 + self.set_back_s
        )

    def on_state(self, state: RecordingState) -> None:
        self.states.append(state)

    def on_bookmark(self, moment: MarkedMoment) -> None:
        self.bookmarks.append(moment)

    def begin(self, label: str = "") -> str:
        return self.control.start(label=label, notes="", author="")

    def mark(self, label: str = "", age_s: float = 0.0) -> None:
        self.control.mark(label=label, notes="", author="", age_s=age_s)


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    one = Recording(tmp_path)
    yield one
    one.journal.close()


def code(call: Callable[[], object]) -> str:
    with pytest.raises(Refused) as refused:
        call()
    return refused.value.code


def test_only_current_facts_of_a_pause_are_recorded(recording: Recording) -> None:
    recording.receive(1)
    recording.control.stop()
    recording.receive(2)
    recording.receive(7, 8, fact="market")
    recording.begin()
    recording.receive(9)
    recording.control.stop()
    assert ticks(recording.file("2026-03-01")) == [1]
    assert ticks(recording.file("2026-03-01", 2)) == [8, 9]


def test_label_notes_and_author_last_until_next_start(recording: Recording) -> None:
    recording.control.stop()
    recording.control.start(label="morning", notes="a class", author="anna")
    state = recording.states[-1]
    assert (state.label, state.notes, state.author) == ("morning", "a class", "anna")
    recording.control.stop()
    state = recording.states[-1]
    assert (state.label, state.is_recording) == ("morning", False)
    recording.begin("noon")
    state = recording.states[-1]
    assert (state.file, state.notes) == ("journal-2026-03-01_003.mcap", "")


def test_bookmarks_are_counted_and_published_to_their_limit(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_control, "MOST_BOOKMARKS", 2)
    recording.now_ns += 5 * 10**9
    recording.mark("odd")
    recording.mark(age_s=1.5)
    marked = [(one.label, one.at_ns) for one in recording.bookmarks]
    assert marked == [("odd", 6_000_000_000), ("", 4_500_000_000)]
    assert recording.states[-1].bookmarks == 2
    assert code(recording.mark) == "TOO_MANY"


@pytest.mark.parametrize("age_s", [-0.1, 5.1, math.nan, math.inf])
def test_moment_outside_the_recording_is_rejected(recording: Recording, age_s: float) -> None:
    recording.now_ns += 5 * 10**9
    assert code(lambda: recording.mark(age_s=age_s)) == "OUT_OF_RANGE"
    assert recording.bookmarks == []


def test_clock_set_back_still_allows_bookmarks(recording: Recording) -> None:
    recording.now_ns -= 5 * 10**8
    recording.set_back_s = 5.0
    recording.mark("odd", age_s=0.25)
    assert [one.at_ns for one in recording.bookmarks] == [250_000_000]


def test_request_in_wrong_state_is_rejected_without_change(recording: Recording) -> None:
    assert code(recording.begin) == "RECORDING_ALREADY"
    recording.control.stop()
    assert code(recording.control.stop) == "NOT_RECORDING"
    assert code(recording.mark) == "NOT_RECORDING"
    assert len(recording.states) == 2
    assert recording.bookmarks == []


def test_unwritable_or_locked_folder_is_reported(recording: Recording) -> None:
    recording.control.stop()
    other = lock_folder(recording.folder)
    assert code(recording.begin) == "IN_USE"
    os.close(other)
    moved = recording.folder.with_name("moved")
    recording.folder.rename(moved)
    recording.folder.write_text("no folder")
    assert code(recording.begin) == "CANNOT_WRITE"
    recording.folder.unlink()
    moved.rename(recording.folder)
    assert "is being recorded" in recording.begin()


def test_next_day_file_continues_the_same_recording(recording: Recording) -> None:
    recording.control.stop()
    recording.begin("night")
    recording.today += timedelta(days=1)
    recording.flush()
    recording.control.check_file()
    state = recording.states[-1]
    assert (state.file, state.label) == ("journal-2026-03-02_001.mcap", "night")
    told = len(recording.states)
    recording.control.check_file()
    assert len(recording.states) == told
