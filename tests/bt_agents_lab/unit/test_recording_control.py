# SPDX-License-Identifier: Apache-2.0
"""Recordings started, bookmarked and stopped by hand; each file is complete."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path

import pytest

from bt_agents_core.errors import Refused
from bt_agents_lab.recorder import recording_control
from bt_agents_lab.recorder.daily_recorder import DailyRecorder, lock_folder
from bt_agents_lab.recorder.recording_control import MarkedMoment, RecordingControl, RecordingState
from journal_fixture import recorded, ticks


class Recording:
    """A recorder, its control, and its published states."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.today = date(2026, 3, 1)
        self.states: list[RecordingState] = []
        self.bookmarks: list[MarkedMoment] = []
        self.now_ns = 10**9
        self.recorder = DailyRecorder(
            folder, days=0, today=lambda: self.today, report=lambda _text, _is_error: None
        )
        self.control = RecordingControl(self.recorder, self, lambda: self.now_ns)

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
    one.recorder.close()


def code(call: Callable[[], object]) -> str:
    with pytest.raises(Refused) as refused:
        call()
    return refused.value.code


def test_journal_records_from_start_without_label(recording: Recording) -> None:
    [state] = recording.states
    found = (state.is_recording, state.label, state.file)
    assert found == (True, "", "journal-2026-03-01_001.mcap")


def test_messages_between_stop_and_start_are_not_recorded(recording: Recording) -> None:
    recording.recorder.record(recorded(1))
    recording.control.stop()
    recording.recorder.record(recorded(2))
    recording.begin()
    recording.recorder.record(recorded(3))
    recording.control.stop()
    first, second = sorted(recording.folder.glob("*.mcap"))
    assert ticks(first) == [1]
    assert ticks(second) == [3]


def test_new_recording_begins_with_current_facts(recording: Recording) -> None:
    recording.control.stop()
    recording.recorder.record(recorded(7), fact="market")
    recording.recorder.record(recorded(8), fact="market")
    recording.begin()
    recording.control.stop()
    assert ticks(sorted(recording.folder.glob("*.mcap"))[-1]) == [8]


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


def test_bookmarks_are_counted_and_published(recording: Recording) -> None:
    recording.now_ns += 5 * 10**9
    recording.mark("odd")
    recording.mark(age_s=1.5)
    marked = [(one.label, one.at_ns) for one in recording.bookmarks]
    assert marked == [("odd", 6_000_000_000), ("", 4_500_000_000)]
    assert recording.states[-1].bookmarks == 2


@pytest.mark.parametrize("age_s", [-0.1, 5.1, math.nan, math.inf])
def test_moment_outside_the_recording_is_rejected(recording: Recording, age_s: float) -> None:
    recording.now_ns += 5 * 10**9
    assert code(lambda: recording.mark(age_s=age_s)) == "OUT_OF_RANGE"
    assert recording.bookmarks == []


def test_request_in_wrong_state_is_rejected_without_change(recording: Recording) -> None:
    assert code(recording.begin) == "RECORDING_ALREADY"
    recording.control.stop()
    assert code(recording.control.stop) == "NOT_RECORDING"
    assert code(recording.mark) == "NOT_RECORDING"
    assert len(recording.states) == 2
    assert recording.bookmarks == []


def test_bookmarks_beyond_limit_are_rejected(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_control, "MOST_BOOKMARKS", 1)
    recording.mark()
    assert code(recording.mark) == "TOO_MANY"


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
    recording.today = date(2026, 3, 2)
    recording.recorder.flush(10**9)
    recording.control.check_file()
    state = recording.states[-1]
    assert (state.file, state.label) == ("journal-2026-03-02_001.mcap", "night")
    told = len(recording.states)
    recording.control.check_file()
    assert len(recording.states) == told
