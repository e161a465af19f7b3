# SPDX-License-Identifier: Apache-2.0
"""The files of tuning: what is written is on the disk, and what is broken in them is named."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bt_agents.host.tuning import change_log as journal_module
from bt_agents.host.tuning.change_log import Journal
from bt_agents.host.tuning.change_log_lines import revision_line
from bt_agents.host.tuning.history import (
    MOST_UNDONE,
    TuningAction,
    TuningCause,
    TuningChange,
    TuningRevision,
)
from bt_agents.host.tuning.overrides import Override
from bt_agents.host.tuning.presets import Presets, presets_text, read_presets
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
    return tmp_path / "state" / "tunings.jsonl"


def opened(path: Path, disk: Disk | None = None, told: list[str] | None = None) -> Journal:
    tell = told.append if told is not None else pytest.fail
    return Journal(path, disk or Disk(), tell)


def reopened(path: Path) -> Journal:
    journal = opened(path)
    journal.close()
    return journal


def test_what_was_written_is_there_after_a_restart(path):
    journal = opened(path)
    journal.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    journal.append(revision(2, 12.0, 8.0, of=1), {"a.x": 8.0})
    journal.append(revision(3, 8.0, 10.0), {"a.x": 8.0})
    journal.close()
    again = reopened(path)
    assert again.problems == []
    assert again.remembered.kept == {"a.x": Override(value=10.0, default=8.0)}
    assert again.remembered.history.undoable == (revision(3, 8.0, 10.0),)
    assert again.remembered.history.revision == 3
    assert [one.number for one, _ in again.remembered.history.shown] == [1, 2, 3]


def test_a_value_that_is_as_in_the_file_again_is_not_kept(path):
    journal = opened(path)
    journal.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    journal.append(revision(2, 12.0, 8.0), {"a.x": 8.0})
    journal.close()
    assert reopened(path).remembered.kept == {}


@pytest.mark.parametrize("torn", [b'{"revision":2,"sta', b'{"revision":2}', b"\xff\xfe"])
def test_a_torn_last_line_is_dropped_with_words_and_the_next_one_is_whole(path, torn):
    journal = opened(path)
    journal.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    journal.close()
    with path.open("ab") as file:
        file.write(torn)
    again = opened(path)
    assert again.problems == [f"{path}:2: its end is missing; it is left out"]
    again.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    again.close()
    last = reopened(path)
    assert last.problems == []
    assert last.remembered.kept["a.x"].value == 9.0


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("garbage", "no JSON"),
        ("[" * 100_000, "no JSON"),
        ("[]", "the line is no mapping"),
        ('{"format": 9}', "format 9, expected 1"),
        ('{"revision": 2}', "action None, expected set, undo or redo"),
        ('{"action": "set", "revision": 2, "stamp": NaN}', "NaN is no number"),
        ('{"action": "set", "revision": -1, "stamp": 1}', "'author' is no text"),
        (
            '{"action":"undo","revision":2,"stamp":1,"author":"","reason":"","of":7,'
            '"changes":[],"defaults":{}}',
            "revision 7 cannot be taken back",
        ),
        (
            '{"action":"set","revision":2,"stamp":1,"author":"","reason":"","of":0,'
            '"changes":[{"name":"a.x","before":1,"after":[]}],"defaults":{}}',
            "a value is no number, text, true or false",
        ),
    ],
)
def test_a_line_that_cannot_be_read_is_left_out_with_its_place_and_the_rest_is_used(
    path, line, words
):
    journal = opened(path)
    journal.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    journal.close()
    good = path.read_text()
    path.write_text(f"{line}\n{good}")
    again = reopened(path)
    assert len(again.problems) == 1
    assert again.problems[0].startswith(f"{path}:1: ")
    assert words in again.problems[0]
    assert again.problems[0].endswith("; it is left out")
    assert again.remembered.kept["a.x"].value == 12.0


def test_a_file_full_of_garbage_is_told_in_a_few_lines(path):
    path.parent.mkdir()
    path.write_bytes(b"\xff\n" * 1000)
    assert len(reopened(path).problems) == 21


def test_a_long_file_becomes_short_and_says_the_same(path, monkeypatch):
    monkeypatch.setattr(journal_module, "MOST_LINES", 50)
    journal = opened(path)
    for number in range(1, 52):
        one = revision(number, number - 1.0, float(number))
        journal.append(one, {"a.x": 0.0})
        journal.remembered.take(one, {"a.x": 0.0})
    assert journal.is_long
    journal.shorten(journal.remembered)
    assert not journal.is_long
    assert path.read_text().count("\n") == 1
    journal.append(revision(52, 51.0, 52.0), {"a.x": 0.0})
    journal.close()
    again = reopened(path)
    assert again.problems == []
    assert again.remembered.kept["a.x"].value == 52.0
    assert [one.number for one in again.remembered.history.undoable] == list(range(1, 53))
    assert len(again.remembered.history.shown) == 52
    assert len(list(path.parent.iterdir())) == 1


def test_a_disk_that_takes_nothing_refuses_and_leaves_the_file_as_it_was(path, monkeypatch):
    journal = opened(path)
    journal.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    before = path.read_bytes()
    real = os.write

    def half(descriptor: int, content: bytes) -> int:
        real(descriptor, content[:5])
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", half)
        with pytest.raises(Refused, match=r"NOT_KEPT: .*No space left on device"):
            journal.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    assert path.read_bytes() == before
    journal.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    journal.close()
    assert reopened(path).problems == []


def test_a_line_that_could_not_even_be_taken_back_is_gone_before_the_next_one(path, monkeypatch):
    journal = opened(path)
    journal.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    real = os.write

    def half(descriptor: int, content: bytes) -> int:
        real(descriptor, content[:5])
        raise OSError(5, "Input/output error")

    def no(descriptor: int, size: int) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", half)
        patch.setattr(os, "ftruncate", no)
        for _ in range(2):
            with pytest.raises(Refused, match=r"NOT_KEPT: .*Input/output error"):
                journal.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    journal.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    journal.close()
    again = reopened(path)
    assert again.problems == []
    assert again.remembered.kept["a.x"].value == 9.0


def test_a_change_outlives_a_process_that_is_killed(path):
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from test_tuning_files import opened, revision\n"
        "journal = opened(Path(sys.argv[1]))\n"
        "journal.append(revision(1, 8.0, 12.0), {'a.x': 8.0})\n"
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
    assert reopened(path).remembered.kept["a.x"].value == 12.0


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """What the file had in it at each sync."""
    seen: list[bytes] = []
    monkeypatch.setattr(os, "fdatasync", lambda file: seen.append(os.pread(file, 10**6, 0)))
    return seen


def test_a_change_is_written_at_once_and_only_the_disk_waits_for_itself(path, synced):
    disk = Disk(at_once=False)
    journal = opened(path, disk)
    journal.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    assert path.read_bytes().count(b"\n") == 1
    job = journal.sync()
    assert (synced, job.done()) == ([], False)
    disk.turn()
    assert job.done()
    assert synced == [path.read_bytes()]
    journal.close()


def test_what_comes_before_a_sync_begins_shares_it_and_nothing_new_needs_none(path, synced):
    disk = Disk(at_once=False)
    journal = opened(path, disk)
    jobs = []
    for number in range(1, 41):
        journal.append(revision(number, number - 1.0, float(number)), {"a.x": 0.0})
        jobs.append(journal.sync())
    disk.turn()
    assert len(set(map(id, jobs))) == 1
    for number in range(40):
        journal.agree(f"a.x{number}")
    assert journal.sync() is jobs[0]
    assert len(synced) == 1
    journal.append(revision(41, 40.0, 41.0), {"a.x": 0.0})
    assert journal.sync() is not jobs[0]
    disk.turn()
    assert len(synced) == 2
    journal.close()


def test_what_is_written_while_the_file_is_made_short_is_in_both(path):
    disk = Disk(at_once=False)
    journal = opened(path, disk)
    for number in (1, 2, 3):
        one = revision(number, number - 1.0, float(number))
        journal.append(one, {"a.x": 0.0})
        journal.remembered.take(one, {"a.x": 0.0})
    journal.shorten(journal.remembered)
    journal.append(revision(4, 3.0, 4.0), {"a.x": 0.0})
    assert path.read_bytes().count(b"\n") == 4
    disk.turn()
    assert path.read_bytes().count(b"\n") == 2
    journal.append(revision(5, 4.0, 5.0), {"a.x": 0.0})
    disk.turn()
    journal.close()
    again = reopened(path)
    assert again.problems == []
    assert again.remembered.kept["a.x"].value == 5.0
    assert len(again.remembered.history.undoable) == 5
    assert len(list(path.parent.iterdir())) == 1


def test_a_file_that_cannot_be_made_short_stays_and_is_said(path, monkeypatch):
    told: list[str] = []
    disk = Disk(at_once=False)
    journal = opened(path, disk, told)
    journal.append(revision(1, 8.0, 12.0), {"a.x": 8.0})
    journal.shorten(journal.remembered)

    def no(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", no)
        disk.turn()
    journal.append(revision(2, 12.0, 9.0), {"a.x": 8.0})
    disk.turn()
    journal.close()
    assert told == [
        "the file of tunings grows, it cannot be written anew: [Errno 30] Read-only file system"
    ]
    assert reopened(path).remembered.kept["a.x"].value == 9.0
    assert len(list(path.parent.iterdir())) == 1


def test_two_hosts_cannot_have_the_same_file(path):
    first = opened(path)
    with pytest.raises(BtAgentsError, match="in use by another host; give each host a file"):
        opened(path)
    first.shorten(first.remembered)
    with pytest.raises(BtAgentsError, match="in use by another host"):
        opened(path)
    first.close()
    reopened(path)


def test_a_file_that_cannot_be_opened_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BtAgentsError, match="cannot be opened"):
        opened(tmp_path / "file" / "tunings.jsonl")


def test_ten_thousand_lines_are_read_and_bounded(path):
    journal = opened(path)
    journal.close()
    lines = []
    for number in range(1, 10_001):
        lines.append(revision_line(revision(number, number - 1.0, float(number)), {"a.x": 0.0}))
    path.write_text("".join(lines))
    again = reopened(path)
    assert again.remembered.kept["a.x"].value == 10_000.0
    assert len(again.remembered.history.undoable) == MOST_UNDONE


PRESETS = {
    "morning": {"a.patience": "12 s", "a.place": 'say "hi": #1'},
    "care home": {"b.loud": "true"},
}


def test_presets_are_kept_in_a_file_that_people_can_read(tmp_path):
    file = tmp_path / "presets.yaml"
    presets = Presets(file)
    for name, values in PRESETS.items():
        presets.save(name, values)
    assert file.read_text() == (
        "format: 1\n"
        "presets:\n"
        '  "care home":\n'
        '    b.loud: "true"\n'
        '  "morning":\n'
        '    a.patience: "12 s"\n'
        "    a.place: 'say \"hi\": #1'\n"
    )
    again = Presets(file)
    assert again.by_name == PRESETS
    assert list(again.by_name) == ["care home", "morning"]
    again.forget("morning")
    assert list(Presets(file).by_name) == ["care home"]
    again.forget("care home")
    assert Presets(file).by_name == {}


def test_an_empty_file_of_presets_holds_none(tmp_path):
    file = tmp_path / "presets.yaml"
    file.touch()
    presets = Presets(file)
    assert (presets.by_name, presets.problem) == ({}, "")


def test_an_author_may_write_presets_by_hand(tmp_path):
    file = tmp_path / "presets.yaml"
    file.write_text("format: 1\npresets:\n  early: {a.patience: 12 s}  # for Mrs Smith\n")
    assert read_presets(file) == {"early": {"a.patience": "12 s"}}


def test_a_broken_file_of_presets_is_named_and_never_overwritten(tmp_path):
    file = tmp_path / "presets.yaml"
    file.write_text("format: 1\npresets:\n  x: [1]\n")
    presets = Presets(file)
    assert f"{file}:3:6" in presets.problem
    for act in (lambda: presets.save("y", {}), lambda: presets.get("x")):
        with pytest.raises(Refused, match=r"BROKEN_PRESETS: .*mend it or move it away"):
            act()
    assert file.read_text().endswith("x: [1]\n")


@pytest.mark.parametrize("name", ["", " x", "x\n", "x" * 61, "\x00", "a\u2028b"])
def test_a_preset_needs_a_name_that_people_can_read(name):
    with pytest.raises(Refused, match="NOT_A_NAME: a preset cannot be called"):
        Presets(None).save(name, {})


def test_an_unknown_preset_is_refused_with_the_nearest():
    presets = Presets(None)
    with pytest.raises(Refused, match="UNKNOWN_PRESET: no preset 'x'; 'bt-agents preset save"):
        presets.get("x")
    presets.save("morning", {})
    with pytest.raises(Refused, match="did you mean 'morning'"):
        presets.forget("mornin")


def test_presets_are_bounded():
    presets = Presets(None)
    for number in range(100):
        presets.save(f"p{number}", {})
    with pytest.raises(Refused, match="TOO_MANY: 101 presets"):
        presets.save("one more", {})
    with pytest.raises(Refused, match="TOO_MANY: 100 presets with 10001 values"):
        presets.save("p0", {f"a.x{number}": "1" for number in range(10_001)})
    assert presets.by_name["p0"] == {}


def test_ten_thousand_values_of_presets_can_be_read_again(tmp_path):
    file = tmp_path / "presets.yaml"
    values = {f"agent_{number}.patience": "12 s" for number in range(10_000)}
    file.write_text(presets_text({"all": values}))
    assert Presets(file).by_name == {"all": values}
