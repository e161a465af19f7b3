# SPDX-License-Identifier: Apache-2.0
"""Log files of a system, their bounds, and reports on its processes."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bt_agents_core.health import Health, PartHealth
from bt_agents_tools.launcher import log_files
from bt_agents_tools.launcher.log_files import LogFile, make_log_folder, new_log_folder
from bt_agents_tools.launcher.process_report import ProcessReport, Usage, read_usage
from bt_agents_tools.launcher.supervisor import ProcessState, SupervisedProcess

WRITES = """
import sys
for number in range(2000):
    print(number, flush=True)
    sys.stdin.readline() if number % 100 == 99 else None
"""


def test_log_tail_reads_only_end_of_current_start(tmp_path: Path) -> None:
    log = LogFile(tmp_path / "log")
    with log.open(1) as file:
        file.write(b"of the first start\n")
    with log.open(2) as file:
        assert log.tail(5) == []
        file.write(b"x" * 1000 + b"\nsecond\n")
        file.flush()
        assert log.tail(1) == ["second"]
        assert log.tail(5)[0] == "x" * 500
        file.truncate(10**11)  # a hundred sparse gigabytes
        file.seek(0, os.SEEK_END)
        file.write(b"\nlast\n")
    begin = time.monotonic()
    assert log.tail(1) == ["last"]
    assert time.monotonic() - begin < 10.0, "the whole file takes longer"


def test_oversized_log_is_truncated_during_writing(tmp_path: Path) -> None:
    log = LogFile(tmp_path / "agents.log", most_bytes=250)
    kept: set[int] = set()
    command = [sys.executable, "-c", WRITES]
    with (
        log.open(1) as file,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=file) as process,
    ):
        assert process.stdin is not None
        for last in range(99, 2000, 100):
            end = time.monotonic() + 20
            while log.tail(1) != [str(last)]:
                assert time.monotonic() < end, log.tail(1)
            log.rotate()
            assert log.path.stat().st_size == 0
            kept |= {int(line) for line in log.older.read_text().split() if line}
            assert log.older.stat().st_size == 250
            process.stdin.write(b"go on\n")
            process.stdin.flush()
        assert process.wait(20) == 0
    assert {number for number in range(2000) if number % 100 >= 51} <= kept


def test_log_below_size_limit_is_kept(tmp_path: Path) -> None:
    log = LogFile(tmp_path / "agents.log", most_bytes=400)
    with log.open(1) as file:
        file.write(b"x" * 399)
        file.flush()
        log.rotate()
        assert not log.older.exists()
        file.write(b"x")
        file.flush()
        log.rotate()
        file.write(b"next line")
    assert log.path.read_bytes() == b"next line"
    assert log.older.read_bytes() == b"x" * 400
    assert {path.stat().st_mode & 0o777 for path in (log.path, log.older)} == {0o600}
    assert log.tail(1) == ["next line"]


def test_log_cleanup_keeps_newest_ended_starts(tmp_path: Path) -> None:
    home = log_files.log_home(str(tmp_path))
    ended_process = subprocess.Popen([sys.executable, "-c", ""])
    ended_process.wait()
    for day in range(1, log_files.MOST_FOLDERS + 6):
        (home / f"2026-01-{day:02}-000000-{ended_process.pid}").mkdir(parents=True)
    running = home / f"2025-01-01-000000-{os.getpid()}"
    of_somebody = home / "notes"
    for folder in (running, of_somebody):
        folder.mkdir()
    folder = new_log_folder(str(tmp_path))
    make_log_folder(folder)
    assert {running, of_somebody, folder} <= set(home.iterdir())
    left = log_files.ended(home, log_files.is_running)
    assert [one.name[8:10] for one in left] == [f"{day:02}" for day in range(6, 26)]


MORNING_S = 1_800_000_000.0


class Reported:
    """A process, its resources, and the report about it."""

    def __init__(self, folder: Path) -> None:
        self.now = 100.0
        self.looks = 0
        self.usage: Usage | None = Usage(cpu_s=1.0, memory_bytes=50_000_000)
        self.unknown: dict[str, str] = {}
        self.process = SupervisedProcess(
            name="robot",
            pid=17,
            state=ProcessState.STARTING,
            since=90.0,
            restarts=0,
            last_exit="",
            log=LogFile(folder / "robot.log"),
        )
        self.report = ProcessReport(
            lambda: [self.process],
            lambda: self.unknown,
            clock=lambda: self.now,
            wall_clock=lambda: MORNING_S + self.now - 100.0,
            usage=self._used,
        )

    def _used(self, pid: int) -> Usage | None:
        assert pid == self.process.pid
        self.looks += 1
        return self.usage

    def change(self, **fields: Any) -> None:
        self.process = replace(self.process, **fields)

    def part(self) -> PartHealth:
        [part] = self.report.parts()
        return part

    def values(self) -> Mapping[str, str]:
        return self.part().values


@pytest.fixture
def reported(tmp_path: Path) -> Reported:
    return Reported(tmp_path)


def test_report_has_state_its_beginning_and_last_exit(reported: Reported) -> None:
    first = reported.part()
    assert (first.part, first.level, first.message) == ("robot", Health.WARN, "starting")
    assert first.values["since"] == "2027-01-15T07:59:50Z"
    reported.now += 5
    reported.change(state=ProcessState.UP, since=103.0)
    up = reported.part()
    assert (up.level, up.message, up.values["pid"]) == (Health.OK, "up", "17")
    reported.now += 5
    assert reported.values()["since"] == "2027-01-15T08:00:03Z"
    killed = "killed by signal 9"
    reported.change(state=ProcessState.ENDED, since=109.0, restarts=1, last_exit=killed)
    ended = reported.part()
    assert (ended.level, ended.message) == (Health.ERROR, "ended")
    assert [ended.values[key] for key in ("last exit", "pid", "restarts")] == [killed, "", "1"]


def test_usage_is_read_at_most_once_a_second(reported: Reported) -> None:
    assert reported.values()["memory"] == "50 MB"
    reported.usage = Usage(cpu_s=1.25, memory_bytes=60_000_000)
    for _ in range(4):
        reported.now += 0.2
        assert reported.values()["memory"] == "50 MB"
    assert reported.looks == 1
    reported.now += 0.2
    values = reported.values()
    assert (values["cpu"], values["memory"], reported.looks) == ("25 %", "60 MB", 2)


def test_restarted_process_has_no_share_of_earlier_start(reported: Reported) -> None:
    reported.part()
    reported.now += 1
    reported.change(pid=18)
    reported.usage = Usage(cpu_s=0.1, memory_bytes=1_000_000)
    assert reported.values()["cpu"] == ""


def test_gone_process_reports_no_usage(reported: Reported) -> None:
    reported.usage = None
    values = reported.values()
    assert (values["cpu"], values["memory"]) == ("", "")


def test_unknown_parameters_are_one_part_with_warning(reported: Reported) -> None:
    reported.unknown = {"/** pacee": "my.yaml: no node here has a parameter 'pacee'"}
    _, part = reported.report.parts()
    assert (part.part, part.level) == ("parameters", Health.WARN)
    assert part.values == reported.unknown


def test_last_log_line_is_short_printable_and_unstamped(reported: Reported) -> None:
    with reported.process.log.open(1) as log:
        log.write("first\n\x1b[31m\u202ered ".encode() + b"x" * 5_000 + b"\n")
        log.flush()
        line = reported.values()["log"]
        assert (line[:18], len(line)) == (r"\x1b[31m\u202ered ", 200)
        log.write(b"[WARN] [1795757361.910022878] [robot]: [12] [a]: nobody answers\n")
    reported.now += 1
    assert reported.values()["log"] == "[WARN] [12] [a]: nobody answers"


def test_usage_comes_from_proc() -> None:
    usage = read_usage(os.getpid())
    assert usage is not None
    assert usage.cpu_s > 0
    assert usage.memory_bytes > 1_000_000
    assert read_usage(2**22) is None, "above the highest process id"
