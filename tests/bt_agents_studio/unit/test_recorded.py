# SPDX-License-Identifier: Apache-2.0
"""Looking into a recording: also what the journal has received and not written yet is shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_agents_interfaces.msg import RecordingStatus
from bt_agents_lab.recorder.file import JournalFile
from bt_agents_studio.studio import Studio
from journal_fixture import recorded
from studio_harness import SPACE

NOW_S = 1000.0
NEWEST_S = 2.0**40


class Recording:
    """A file that a journal writes, and a studio whose waits are counted."""

    def __init__(self, folder: Path) -> None:
        self.file = JournalFile(folder / "journal-2026-03-01_001.mcap")
        self.name = self.file.path.name
        self.waits: list[float] = []
        self.writes_after = 0
        self.studio = Studio(
            "studio", space=SPACE, journal=folder, clock=lambda: NOW_S, sleep=self._sleep
        )
        self._status(recording=True)
        self.write(1)

    def _sleep(self, wait_s: float) -> None:
        self.waits.append(wait_s)
        if len(self.waits) == self.writes_after:
            self.write(2)

    def _status(self, *, recording: bool) -> None:
        status = RecordingStatus(recording=recording, file=self.name)
        kind = "bt_agents_interfaces/msg/RecordingStatus"
        self.studio.receive(kind, status, NOW_S, False)

    def stop(self) -> None:
        self._status(recording=False)

    def write(self, number: int) -> None:
        self.file.add(recorded(number), number)
        self.file.flush()


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    return Recording(tmp_path)


def test_newest_moment_of_active_recording_waits_for_flush(recording: Recording) -> None:
    recording.writes_after = 3
    size = recording.file.path.stat().st_size
    recording.studio.recorded(recording.name, NEWEST_S)
    assert len(recording.waits) == 3
    assert recording.file.path.stat().st_size > size


def test_quiet_system_waits_only_briefly(recording: Recording) -> None:
    recording.studio.recorded(recording.name, NEWEST_S)
    assert 1.0 < sum(recording.waits) < 1.5


def test_earlier_moment_is_shown_at_once(recording: Recording) -> None:
    recording.studio.recorded(recording.name, NOW_S - 1.0)
    assert recording.waits == []


def test_finished_recording_is_shown_at_once(recording: Recording) -> None:
    recording.stop()
    recording.studio.recorded(recording.name, NEWEST_S)
    assert recording.waits == []
