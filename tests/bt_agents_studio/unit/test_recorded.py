# SPDX-License-Identifier: Apache-2.0
"""Moments of a recording: waiting for unwritten ones, and reading as the file grows."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import RecordingStatus, Run
from bt_agents_lab.recorder import reading
from bt_agents_lab.recorder.file import JournalFile
from bt_agents_studio.recordings import Recordings
from bt_agents_studio.studio import Studio
from journal_fixture import add_messages, recorded, ticks
from studio_harness import SPACE

NOW_S = 1000.0
NEWEST_S = 2.0**40


class Recording:
    """A file that a journal writes, and recordings that count their waits."""

    def __init__(self, folder: Path) -> None:
        self.file = JournalFile(folder / "journal-2026-03-01_001.mcap")
        self.path = self.file.path
        self.waits: list[float] = []
        self.writes_after = 0
        self.recordings = Recordings("mood", sleep=self._sleep)
        self.studio = Studio("studio", space=SPACE, journal=folder, clock=lambda: NOW_S)
        self.status(recording=True)
        self.write(1)

    def _sleep(self, wait_s: float) -> None:
        self.waits.append(wait_s)
        if len(self.waits) == self.writes_after:
            self.write(2)

    def status(self, *, recording: bool) -> None:
        status = RecordingStatus(recording=recording, file=self.path.name)
        kind = "bt_agents_interfaces/msg/RecordingStatus"
        self.studio.receive(kind, status, NOW_S, False)

    def write(self, number: int) -> None:
        self.file.add(recorded(number), number)
        self.file.flush()

    def tick(self) -> int:
        """Return the tick of the run at the end of the recording."""
        entries = json.loads(self.recordings.moment(self.path, NEWEST_S).entries)
        (run,) = entries["runs"].values()
        return int(run["tick"])


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    return Recording(tmp_path)


def test_newest_moment_of_active_recording_waits_for_flush(recording: Recording) -> None:
    assert recording.studio.is_awaited(recording.path.name, NEWEST_S)
    recording.writes_after = 3
    size = recording.path.stat().st_size
    recording.recordings.moment(recording.path, NEWEST_S, waits=True)
    assert len(recording.waits) == 3
    assert recording.path.stat().st_size > size


def test_quiet_system_waits_only_briefly(recording: Recording) -> None:
    recording.recordings.moment(recording.path, NEWEST_S, waits=True)
    assert 1.0 < sum(recording.waits) < 1.5


def test_earlier_moment_or_finished_recording_is_not_awaited(recording: Recording) -> None:
    assert not recording.studio.is_awaited(recording.path.name, NOW_S - 1.0)
    recording.status(recording=False)
    assert not recording.studio.is_awaited(recording.path.name, NEWEST_S)


def test_growing_recording_is_read_on(recording: Recording) -> None:
    assert recording.tick() == 1
    read = recording.path.stat().st_size
    recording.write(2)
    # Earlier data is not read again: it is gone.
    with recording.path.open("r+b") as file:
        file.write(bytes(read))
    assert recording.tick() == 2


def test_large_recording_is_read_in_parts(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "MOST_FURTHER", 2)
    for number in (2, 3, 4, 5):
        recording.write(number)
    moments = [recording.recordings.moment(recording.path, NEWEST_S) for _ in range(3)]
    shown = [one.snapshot for one in moments]
    assert [one.is_whole for one in shown] == [False, False, True]
    assert [one.last_s for one in shown] == [3.0, 5.0, 6.0]
    assert {one.first_s for one in shown} == {2.0}
    assert recording.tick() == 5


def test_timeline_of_large_recording_grows_with_each_request(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "MOST_FURTHER", 1)
    wholes = [recording.recordings.events(recording.path).is_whole for _ in range(3)]
    assert wholes == [False, True, True]


def test_replaced_recording_is_read_from_its_beginning(recording: Recording) -> None:
    assert recording.tick() == 1
    other = JournalFile(recording.path.with_name("other"))
    for number in (7, 8):
        other.add(recorded(number), number)
    other.close()
    other.path.rename(recording.path)
    assert recording.tick() == 8


def test_recording_that_is_gone_is_refused(recording: Recording) -> None:
    recording.tick()
    recording.path.unlink()
    with pytest.raises(Refused, match="cannot be read: No such file"):
        recording.tick()


def test_timeline_of_recording_is_told_apart_from_moments(recording: Recording) -> None:
    run = Run(epoch="e", round=1, agent="guide", event=Run.STARTED)
    add_messages(recording.file, run, "/bt_agents/runs", [3])
    moment = recording.recordings.moment(recording.path, NEWEST_S)
    assert "events" not in json.loads(moment.entries)
    [event] = recording.recordings.events(recording.path).events
    found = (event.lane, event.kind, event.agent, event.ended_s)
    assert found == ("AGENT", "RUNNING", "guide", None)


def test_excerpt_of_active_recording_waits_for_flush(recording: Recording, tmp_path: Path) -> None:
    recording.writes_after = 2
    into = tmp_path / "excerpt"
    recording.recordings.write_excerpt(recording.path, 2.0, 3.0, into, waits=True)
    assert len(recording.waits) == 2
    assert ticks(into) == [1, 2]


def test_excerpt_without_place_or_journal_is_refused(recording: Recording, tmp_path: Path) -> None:
    write = recording.recordings.write_excerpt
    for into in (recording.path, tmp_path / "a" / "b"):
        with pytest.raises(Refused, match="CANNOT_WRITE"):
            write(recording.path, 0.0, 9.0, into)
    with pytest.raises(Refused, match="UNREADABLE: no journal"):
        write(tmp_path / "gone.mcap", 0.0, 9.0, tmp_path / "excerpt")


def test_worker_answers_and_ends_with_its_input(recording: Recording) -> None:
    command = [sys.executable, "-m", "bt_agents_studio.journal_worker", "mood", ""]
    request = {"file": str(recording.path), "at_s": NEWEST_S, "waits": False}
    timeline = {"file": str(recording.path), "at_s": None}
    into = recording.path.with_name("excerpt")
    span = {"from_s": 2.0, "to_s": 3.0, "into": str(into), "waits": False}
    missing = timeline | {"file": f"{recording.path}.gone"}
    requests = (request, timeline, timeline | span, missing)
    done = subprocess.run(
        command,
        input="".join(f"{json.dumps(one)}\n" for one in requests).encode(),
        capture_output=True,
        timeout=60,
        check=True,
    )
    answers, rest = [], done.stdout
    while rest:
        head, _, rest = rest.partition(b"\n")
        kind, length = head.split()
        answers.append((kind, json.loads(rest[: int(length)] or b"{}")))
        rest = rest[int(length) :]
    moment, events, excerpt, failure = answers
    assert (moment[0], moment[1]["type"]) == (b"found", "snapshot")
    assert (events[0], events[1]["type"]) == (b"found", "events")
    assert (excerpt, ticks(into)) == ((b"found", {}), [1])
    assert (failure[0], failure[1]["code"]) == (b"failure", "NO_JOURNAL")
