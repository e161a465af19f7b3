# SPDX-License-Identifier: Apache-2.0
"""Reports on supervised processes: state, restarts, usage and end of the log."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from bt_agents_core.health import Health, PartHealth
from bt_agents_tools.launcher.log_files import LogFile
from bt_agents_tools.launcher.process_report import ProcessReport, Usage, read_usage
from bt_agents_tools.launcher.supervisor import ProcessState, SupervisedProcess

MORNING_S = 1_800_000_000.0
NO_PID = 4_194_304
"""Above the highest process id."""


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
    reported.process = replace(reported.process, state=ProcessState.UP, since=103.0)
    up = reported.part()
    assert (up.level, up.message, up.values["pid"]) == (Health.OK, "up", "17")
    reported.now += 5
    assert reported.values()["since"] == "2027-01-15T08:00:03Z"
    killed = "killed by signal 9"
    reported.process = replace(
        reported.process, state=ProcessState.ENDED, since=109.0, restarts=1, last_exit=killed
    )
    ended = reported.part()
    assert (ended.level, ended.message) == (Health.ERROR, "ended")
    assert ended.values["last exit"] == killed
    assert (ended.values["pid"], ended.values["restarts"]) == ("", "1")


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
    reported.process = replace(reported.process, pid=18)
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


def test_last_log_line_is_bounded_and_printable(reported: Reported) -> None:
    with reported.process.log.open(1) as log:
        log.write(b"first\n\x1b[31mred " + b"x" * 5_000 + b"\n")
    line = reported.values()["log"]
    assert line.startswith("\\x1b[31mred xxx")
    assert len(line) == 200


def test_log_line_has_no_stamp(reported: Reported) -> None:
    with reported.process.log.open(1) as log:
        log.write(b"[WARN] [1795757361.910022878] [robot]: [12] [a]: nobody answers\n")
    assert reported.values()["log"] == "[WARN] [12] [a]: nobody answers"


def test_usage_comes_from_proc() -> None:
    usage = read_usage(os.getpid())
    assert usage is not None
    assert usage.cpu_s > 0
    assert usage.memory_bytes > 1_000_000
    assert read_usage(NO_PID) is None
