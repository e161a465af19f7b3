# SPDX-License-Identifier: Apache-2.0
"""Log files of a system: reading, and their bounds."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import time
from pathlib import Path

from bt_agents_tools.launcher.log_files import (
    MOST_FOLDERS,
    LogFile,
    ended,
    is_running,
    log_home,
    make_log_folder,
    new_log_folder,
)

WRITES = """
import sys
for number in range(2000):
    print(number, flush=True)
    sys.stdin.readline() if number % 100 == 99 else None
"""


def test_log_tail_is_printable(tmp_path: Path) -> None:
    log = LogFile(tmp_path / "log")
    with log.open(1) as file:
        file.write("a\x1b[2J\u202e\n".encode())
        file.flush()
    assert log.tail(3) == [r"a\x1b[2J\u202e"]


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
    with log.open(1) as file:
        process = subprocess.Popen(
            [sys.executable, "-c", WRITES], stdin=subprocess.PIPE, stdout=file
        )
    kept: set[int] = set()
    try:
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
        process.wait(20)
    finally:
        process.kill()
        process.wait()
        assert process.stdin is not None
        process.stdin.close()
    assert process.returncode == 0
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
    assert log.tail(1) == ["next line"]


def test_logs_are_private_under_any_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = new_log_folder(str(tmp_path))
        make_log_folder(folder)
        log = LogFile(folder / "agents.log", most_bytes=1)
        log.open(1).close()
        with log.open(2) as file:
            file.write(b"line")
        log.rotate()
    finally:
        os.umask(before)
    modes = {path: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.rglob("*")}
    assert modes == {folder.parent: 0o700, folder: 0o700, log.path: 0o600, log.older: 0o600}


def test_log_cleanup_keeps_newest_ended_starts(tmp_path: Path) -> None:
    home = log_home(str(tmp_path))
    ended_process = subprocess.Popen([sys.executable, "-c", ""])
    ended_process.wait()
    for day in range(1, MOST_FOLDERS + 6):
        (home / f"2026-01-{day:02}-000000-{ended_process.pid}").mkdir(parents=True)
    running = home / f"2025-01-01-000000-{os.getpid()}"
    of_somebody = home / "notes"
    for folder in (running, of_somebody):
        folder.mkdir()
    folder = new_log_folder(str(tmp_path))
    make_log_folder(folder)
    assert {running, of_somebody, folder} <= set(home.iterdir())
    left = ended(home, is_running)
    assert [one.name[8:10] for one in left] == [f"{day:02}" for day in range(6, 26)]
