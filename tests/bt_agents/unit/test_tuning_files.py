# SPDX-License-Identifier: Apache-2.0
"""File of tunings: written values survive, and damaged files are set aside."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from bt_agents.host.tuning import change_log
from bt_agents.host.tuning.change_log import ChangeLog, read_history
from bt_agents.host.tuning.history import TuningCause, TuningChange, TuningHistory, TuningRevision
from bt_agents.host.tuning.tunable import Setting
from bt_agents_core.errors import BtAgentsError, Refused
from faulty_disk import Disk


def tuned(value: Setting, default: Setting = 8.0) -> TuningHistory:
    revision = TuningRevision(
        number=1,
        stamp=1.0,
        cause=TuningCause(author="anna", reason="too «fast»"),
        changes=(TuningChange(name="a.x", before=default, after=value),),
    )
    return TuningHistory().with_revision(revision, {"a.x": default})


def store(path: Path, history: TuningHistory) -> None:
    log = ChangeLog(path, Disk())
    log.write(history)
    log.close()


def in_force(path: Path) -> Setting:
    return read_history(path).overrides["a.x"].value


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "tunings.json"


@pytest.fixture
def disk() -> Disk:
    """A disk that writes when the test tells it to."""
    return Disk(at_once=False)


@pytest.fixture
def log(path: Path, disk: Disk) -> Iterator[ChangeLog]:
    log = ChangeLog(path, disk)
    yield log
    disk.at_once = True
    log.close()


def files(path: Path) -> list[str]:
    return sorted(one.name for one in path.parent.iterdir())


@pytest.mark.parametrize("value", [True, 1, 1.0, "1.0 s", "it's «1»\n", 2**63 - 1, 1e300])
def test_stored_value_keeps_its_type(path, value):
    store(path, tuned(value, default=""))
    found = in_force(path)
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize("torn", [b"", b'{"format":1,"revi', b"\0" * 500])
def test_power_cut_loses_only_unflushed_revisions(path, disk, log, torn):
    log.write(tuned(12.0))
    log.flush()
    disk.turn()
    log.write(tuned(9.0))
    assert in_force(path) == 9.0
    path.with_name("tunings.json.new").write_bytes(torn)
    assert in_force(path) == 12.0


def test_a_write_waits_for_no_disk(path, disk, log, monkeypatch):
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", synced.append)
    log.write(tuned(12.0))
    job = log.flush()
    assert (synced, job.done(), path.exists()) == ([], False, False)
    disk.turn()
    assert (len(synced), job.done(), path.exists()) == (2, True, True)


def test_writes_before_a_flush_starts_share_it(path, disk, log):
    jobs = []
    for value in range(40):
        log.write(tuned(float(value)))
        jobs.append(log.flush())
    assert len(disk.jobs) == len({*map(id, jobs)}) == 1
    disk.turn()
    assert log.flush() is jobs[0]
    log.write(tuned(41.0))
    assert log.flush() is not jobs[0]
    disk.turn()
    assert in_force(path) == 41.0


def test_write_during_flush_is_flushed_next(path, disk, log, monkeypatch):
    log.write(tuned(12.0))
    log.flush()
    sync = os.fsync

    def write_meanwhile(file: int) -> None:
        monkeypatch.setattr(os, "fsync", sync)
        log.write(tuned(9.0))

    monkeypatch.setattr(os, "fsync", write_meanwhile)
    disk.turn()
    assert files(path) == ["tunings.json.lock", "tunings.json.new"]
    log.flush()
    disk.turn()
    assert files(path) == ["tunings.json", "tunings.json.lock"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"garbage", "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b"[]", "not JSON with a format"),
        (b'{"format": 1}', "KeyError: 'revisions'"),
        (b"9" * 2000, "more than 1000 bytes"),
    ],
    ids=["text", "bytes", "deep", "list", "empty", "large"],
)
def test_damaged_file_is_set_aside_with_warning(path, content, words, monkeypatch):
    monkeypatch.setattr(change_log, "MOST_BYTES", 1000 if len(content) == 2000 else 10**6)
    path.parent.mkdir()
    path.write_bytes(content)
    log = ChangeLog(path, Disk())
    assert log.problem.startswith(f"{path} is damaged: ")
    assert re.search(words, log.problem)
    assert log.problem.endswith("everything stands as the files of the agents say")
    [aside] = path.parent.glob("*.damaged-*")
    assert aside.read_bytes() == content
    assert log.history == TuningHistory()
    log.write(tuned(12.0))
    log.close()
    assert in_force(path) == 12.0


@pytest.mark.parametrize("value", [[], None, float("nan"), 2**63])
def test_a_value_that_no_parameter_has_is_damage(path, value):
    store(path, tuned(12.0))
    content = json.loads(path.read_text())
    content["revisions"][0][-1][0][1] = value
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"is not a number|not finite|64 bits"):
        read_history(path)


def test_a_file_of_another_format_is_left_alone(path):
    path.parent.mkdir()
    path.write_text('{"format": 9}')
    with pytest.raises(BtAgentsError, match="is not a file of tunings of format 1; move it away"):
        ChangeLog(path, Disk())
    assert path.read_text() == '{"format": 9}'


@pytest.mark.parametrize(("number", "code"), [(28, "STORAGE_FULL"), (5, "CANNOT_WRITE")])
def test_unwritable_file_refuses_changes(path, monkeypatch, number, code):
    log = ChangeLog(path, Disk())
    log.write(tuned(12.0))

    def fail(*_arguments: object, **_keywords: object) -> None:
        raise OSError(number, "the disk is full")

    monkeypatch.setattr(change_log, "write_atomically", fail)
    with pytest.raises(Refused, match=f"{code}: .*cannot be written: the disk is full; nothing"):
        log.write(tuned(9.0))
    log.close()
    assert in_force(path) == 12.0


def test_two_hosts_cannot_share_a_file(path):
    first = ChangeLog(path, Disk())
    with pytest.raises(BtAgentsError, match="in use by another host; give each host a file"):
        ChangeLog(path, Disk())
    first.close()
    ChangeLog(path, Disk()).close()


def test_unopenable_file_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.json").mkdir()
    for path in (tmp_path / "file" / "tunings.json", tmp_path / "folder.json"):
        with pytest.raises(BtAgentsError, match="cannot be opened"):
            ChangeLog(path, Disk())
