# SPDX-License-Identifier: Apache-2.0
"""The files of tuning: what is written is on the disk, and what is broken in them is named."""

from __future__ import annotations

import os
import re
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from bt_agents.host.tuning import change_log
from bt_agents.host.tuning.change_log import ChangeLog
from bt_agents.host.tuning.history import (
    Override,
    TuningAction,
    TuningCause,
    TuningChange,
    TuningRevision,
)
from bt_agents_core.errors import BtAgentsError, Refused
from faulty_disk import Disk


def revision(number: int, before: float, after: float, *, of: int = 0) -> TuningRevision:
    action = TuningAction.UNDO if of else TuningAction.SET
    return TuningRevision(
        number=number,
        stamp=float(number),
        cause=TuningCause(author="anna", reason="too «fast»", action=action, of=of),
        changes=(TuningChange(name="a.x", before=before, after=after),),
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "tunings.sqlite"


def opened(path: Path, disk: Disk | None = None, reports: list[str] | None = None) -> ChangeLog:
    report = reports.append if reports is not None else pytest.fail
    return ChangeLog(path, disk or Disk(), report)


def reopened(path: Path) -> ChangeLog:
    log = opened(path)
    log.close()
    return log


def test_what_was_written_is_there_after_a_restart(path):
    log = opened(path)
    log.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    log.append(revision(2, 12.0, 8.0, of=1), {"a.x": 8.0})
    log.append(revision(3, 8.0, 10.0), {"a.x": 8.0})
    log.close()
    again = reopened(path)
    assert again.problems == []
    assert again.history.overrides == {"a.x": Override(value=10.0, default=8.0)}
    assert list(again.history.undoable) == [revision(3, 8.0, 10.0)]
    assert again.history.revision == 3
    assert [one.number for one, _ in again.history.shown] == [1, 2, 3]
    assert list(path.parent.iterdir()) == [path]


def test_a_value_that_is_as_in_the_file_again_is_not_kept(path):
    log = opened(path)
    log.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    log.append(revision(2, 12.0, 8.0), {"a.x": 8.0})
    log.append(revision(3, 8.0, 9.0), {"a.x": 8.0})
    log.clear("a.x")
    log.close()
    assert reopened(path).history.overrides == {}


@pytest.mark.parametrize("value", [True, 1, 1.0, "1.0 s", "it's «1»\n", 2**63 - 1, 1e300])
def test_a_value_keeps_its_type(path, value):
    log = opened(path)
    change = TuningChange(name="a.x", before="", after=value)
    cause = TuningCause(author="anna")
    log.append(TuningRevision(number=1, stamp=1.0, cause=cause, changes=(change,)), {"a.x": ""})
    log.close()
    found = reopened(path).history.overrides["a.x"].value
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda path: path.write_bytes(b"garbage" * 1000), "file is not a database"),
        (lambda path: path.write_text('{"revision": 1}\n' * 100), "file is not a database"),
        (lambda path: _overwrite(path, 1024, b"\xff" * 3000), "malformed|Page|Tree"),
        (lambda path: os.truncate(path, path.stat().st_size - 1024), "malformed|Page|Tree"),
        (
            lambda path: _sql(path, "DROP TABLE overrides; CREATE TABLE overrides (x)"),
            "no such column",
        ),
    ],
    ids=["bytes", "text", "overwritten", "cut off", "other table"],
)
def test_a_damaged_file_is_set_aside_with_a_warning_and_a_new_one_begins(path, damage, words):
    log = opened(path)
    for number in range(1, 51):
        log.append(revision(number, number - 1.0, float(number)), {"a.x": 0.0})
    log.close()
    damage(path)
    before = path.read_bytes()
    again = opened(path)
    [problem] = again.problems
    assert problem.startswith(f"{path} is damaged: ")
    assert re.search(words, problem)
    assert problem.endswith("everything stands as the files of the agents say")
    [aside] = path.parent.glob("*.damaged-*")
    assert aside.read_bytes() == before
    assert again.history.overrides == {}
    again.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    again.close()
    last = reopened(path)
    assert last.problems == []
    assert last.history.overrides["a.x"].value == 12.0


@pytest.mark.parametrize(
    "other", ["PRAGMA user_version = 9", "PRAGMA application_id = 7"], ids=["newer", "foreign"]
)
def test_a_file_of_another_program_or_version_is_left_alone(path, other):
    reopened(path)
    _sql(path, other)
    before = path.read_bytes()
    with pytest.raises(BtAgentsError, match="is no file of tunings of format 1; move it away"):
        opened(path)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def _overwrite(path: Path, offset: int, content: bytes) -> None:
    with path.open("r+b") as file:
        file.seek(offset)
        file.write(content)


def _sql(path: Path, text: str) -> None:
    db = sqlite3.connect(path)
    db.executescript(text)
    db.close()


def test_a_torn_write_is_dropped_and_what_was_before_it_is_used(path):
    log = opened(path)
    log.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    whole = path.with_name("tunings.sqlite-wal").stat().st_size
    log.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    copy = path.parent / "copy" / path.name
    copy.parent.mkdir()
    for suffix in ("", "-wal"):
        Path(f"{copy}{suffix}").write_bytes(Path(f"{path}{suffix}").read_bytes())
    log.close()
    os.truncate(f"{copy}-wal", whole + 700)
    again = opened(copy)
    assert again.problems == []
    assert again.history.overrides["a.x"].value == 12.0
    again.append(revision(2, 12.0, 7.0), {"a.x": 8.0})
    again.close()
    assert reopened(copy).history.overrides["a.x"].value == 7.0


@pytest.mark.parametrize(
    ("column", "content", "words"),
    [
        ("changes", "garbage", "no JSON"),
        ("changes", "[" * 100_000, "no JSON"),
        ("changes", "{}", "no list of changes"),
        ("changes", '[["a.x", 1]]', "no list of changes"),
        ("changes", '[["a.x", 1, []]]', r"\[\] is no number, text, true or false"),
        ("changes", '[["a.x", 1, NaN]]', "a number is not finite"),
        ("changes", f'[["a.x", 1, {2**63}]]', "more than 64 bits"),
        ("action", "unset", "'unset' is not a valid TuningAction"),
    ],
)
def test_a_row_that_cannot_be_read_is_left_out_with_its_number_and_the_rest_is_used(
    path, column, content, words
):
    log = opened(path)
    log.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    log.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    log.close()
    db = sqlite3.connect(path)
    db.execute(f"UPDATE revisions SET {column} = ? WHERE number = 1", (content,))
    db.commit()
    db.close()
    again = reopened(path)
    [problem] = again.problems
    assert problem.startswith(f"{path}: revision 1: ")
    assert re.search(words, problem)
    assert problem.endswith("; it is left out")
    assert again.history.overrides["a.x"].value == 9.0
    assert [one.number for one in again.history.undoable] == [2]


def test_many_rows_that_cannot_be_read_are_reported_in_a_few_lines(path):
    log = opened(path)
    for number in range(1, 101):
        log.append(revision(number, number - 1.0, float(number)), {"a.x": 0.0})
    log.close()
    _sql(path, "UPDATE revisions SET changes = 'x'; UPDATE overrides SET value = 'x'")
    assert len(reopened(path).problems) == 21


def test_a_long_log_is_compacted_and_says_the_same(path, monkeypatch):
    monkeypatch.setattr(change_log, "MOST_CHANGES", 2500)
    log = opened(path)
    for number in range(1, 2501):
        one = revision(number, number - 1.0, float(number))
        log.append(one, {"a.x": 0.0})
        log.history.add(one, {"a.x": 0.0})
    assert Path(f"{path}-wal").stat().st_size == 0
    log.append(revision(2501, 2500.0, 2501.0), {"a.x": 0.0})
    log.close()
    db = sqlite3.connect(path)
    assert db.execute("SELECT count(*) FROM revisions").fetchone() == (1001,)
    db.close()
    again = reopened(path)
    assert again.problems == []
    assert again.history.overrides["a.x"].value == 2501.0
    numbers = [one.number for one in again.history.undoable]
    assert numbers == list(range(1502, 2502))
    assert len(again.history.shown) == 100


def test_a_log_that_cannot_be_compacted_stays_and_is_reported(path, monkeypatch):
    monkeypatch.setattr(change_log, "MOST_CHANGES", 2)
    reports: list[str] = []
    disk = Disk(at_once=False)
    log = opened(path, disk, reports)
    log.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    log.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    log._db.execute("PRAGMA query_only = ON")
    disk.turn()
    log._db.execute("PRAGMA query_only = OFF")
    [report] = reports
    assert "the file of tunings grows, it cannot be compacted: NOT_KEPT" in report
    disk.at_once = True
    log.close()
    assert reopened(path).history.overrides["a.x"].value == 9.0


def test_a_disk_that_takes_nothing_refuses_and_leaves_the_log_as_it_was(path):
    log = opened(path)
    log.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    [pages] = log._db.execute("PRAGMA page_count").fetchone()
    log._db.execute(f"PRAGMA max_page_count = {pages}")
    long = TuningCause(author="anna", reason="x" * 5000)
    change = TuningChange(name="a.x", before=12.0, after=9.0)
    full = TuningRevision(number=2, stamp=1.0, cause=long, changes=(change,))
    with pytest.raises(Refused, match=r"NOT_KEPT: .*database or disk is full; nothing is changed"):
        log.append(full, {"a.x": 8.0})
    log._db.execute("PRAGMA max_page_count = 1000000")
    log.append(full, {"a.x": 8.0})
    log.close()
    again = reopened(path)
    assert again.problems == []
    assert list(again.history.undoable) == [revision(1, 8.0, 12.0), full]


def test_a_change_outlives_a_process_that_is_killed(path):
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from test_tuning_files import opened, revision\n"
        "log = opened(Path(sys.argv[1]))\n"
        "log.append(revision(1, 8.0, 12.0), {'a.x': 8.0})\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    folders = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "harness")]
    killed = subprocess.run(
        [sys.executable, "-c", program, str(path)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(folders)},
        timeout=60,
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL
    assert reopened(path).history.overrides["a.x"].value == 12.0


@pytest.fixture
def flushed(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """What the write-ahead log had in it at each flush."""
    seen: list[bytes] = []
    monkeypatch.setattr(os, "fdatasync", lambda file: seen.append(os.pread(file, 10**7, 0)))
    return seen


def test_a_change_is_written_at_once_and_only_the_disk_waits_for_itself(path, flushed):
    disk = Disk(at_once=False)
    log = opened(path, disk)
    log.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    written = Path(f"{path}-wal").read_bytes()
    assert "too «fast»".encode() in written
    job = log.flush()
    assert (flushed, job.done()) == ([], False)
    disk.turn()
    assert job.done()
    assert flushed == [written]
    disk.at_once = True
    log.close()


def test_what_comes_before_a_flush_starts_shares_it_and_nothing_new_needs_none(path, flushed):
    disk = Disk(at_once=False)
    log = opened(path, disk)
    jobs = []
    for number in range(1, 41):
        log.append(revision(number, number - 1.0, float(number)), {"a.x": 0.0})
        jobs.append(log.flush())
    disk.turn()
    assert len(set(map(id, jobs))) == 1
    for number in range(40):
        log.clear(f"a.x{number}")
    assert log.flush() is jobs[0]
    assert len(flushed) == 1
    log.append(revision(41, 40.0, 41.0), {"a.x": 0.0})
    assert log.flush() is not jobs[0]
    disk.turn()
    assert len(flushed) == 2
    disk.at_once = True
    log.close()


def test_two_hosts_cannot_have_the_same_file(path):
    first = opened(path)
    first.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    with pytest.raises(BtAgentsError, match="in use by another host; give each host a file"):
        opened(path)
    first.close()
    assert reopened(path).problems == []


def test_a_file_that_cannot_be_opened_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BtAgentsError, match="cannot be opened"):
        opened(tmp_path / "file" / "tunings.sqlite")
    with pytest.raises(BtAgentsError, match="cannot be opened"):
        opened(tmp_path)
