# SPDX-License-Identifier: Apache-2.0
"""Ledgers of the format before, the check of a ledger, and what can be saved of a damaged one."""

from __future__ import annotations

import errno
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner

from bt_agents_core.errors import Refused
from bt_agents_tools.cli.main import bt_agents
from feedback_node.ledger import commit_marker
from feedback_node.ledger.commit_marker import Head, HeadFile, head_path, read_head
from feedback_node.ledger.ledger import Ledger
from feedback_node.ledger.ledger_file import LedgerError
from feedback_node.ledger.ledger_rows import LAYER, RevisionCause
from feedback_node.ledger.recovery import inspect, recover

OLD = Path(__file__).parent.parent / "corpus" / "ledgers" / "format_1.sql"
ANNA = "person/anna"


def old_ledger(path: Path) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.executescript(OLD.read_text(encoding="utf-8"))
        database.execute("PRAGMA journal_mode = WAL")


def made(path: Path) -> Path:
    """Write a ledger of 13 rows: a forgotten layer in it, and the row that says so at its end."""
    with Ledger(path) as ledger:
        ledger.enter({"guide": {"age": 1.0}})
        ledger.append("guide", {"age": 1.0}, RevisionCause(cause=LAYER), layer=ANNA)
        ledger.append("guide", {"age": 2.0}, RevisionCause(feedback_id="a1"), layer=ANNA)
        for number in range(9):
            ledger.append("guide", {"age": float(number)}, RevisionCause(feedback_id=f"f{number}"))
        ledger.forget([("guide", ANNA)])
    return path


def spoil(path: Path, statement: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        triggers = database.execute("SELECT sql FROM sqlite_master WHERE type = 'trigger'")
        texts = [sql for (sql,) in triggers.fetchall()]
        for name in ("update", "delete"):
            database.execute(f"DROP TRIGGER revision_no_{name}")
        database.execute(statement)
        for text in texts:
            database.execute(text)
        database.commit()


def test_a_ledger_of_format_1_is_rewritten_with_every_revision_and_cause(tmp_path):
    path = tmp_path / "ledger.sqlite"
    old_ledger(path)
    with Ledger(path) as ledger:
        rows = ledger.history("guide")
        assert [row.revision for row in rows] == list(range(6))
        assert rows[1].cause == RevisionCause(
            source="button",
            reason="zu laut “ä”",
            feedback_id="f1",
            epoch="e1",
            round=3,
            rate=0.2,
            target={"age": 5.0},
            scene_id="s1",
            cancels=True,
            changes=1,
        )
        assert (dict(rows[1].profile), rows[1].stamp) == (
            {"age": 4.2, "mood": 0.1 + 0.2},
            1700000004.5,
        )
        # The last undo has brought back what one feedback has taught.
        assert [row.cause.changes for row in rows] == [0, 1, 2, 2, 2, 1]
        assert [row.cause.feedback_id for row in ledger.taught("guide", newest=9)] == ["f1"]
        assert ledger.find("tuning/1") == rows[3]
        assert ledger.undo("guide").profile["age"] == 4.0
        assert ledger.enter({"express": {"age": 2.5, "mood": 3.0}})["express"].revision == 1
    assert inspect(path).code == ""


def test_a_ledger_of_format_1_that_makes_no_sense_is_left_alone(tmp_path):
    path = tmp_path / "ledger.sqlite"
    old_ledger(path)
    with closing(sqlite3.connect(path)) as database:
        database.execute("DROP TRIGGER revision_no_DELETE")
        database.execute("DELETE FROM revision WHERE agent = 'guide' AND revision = 2")
        database.commit()
    with pytest.raises(LedgerError, match="revision 2 of guide is not there"):
        Ledger(path)
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("PRAGMA user_version").fetchone() == (1,)
        assert database.execute("SELECT count(*) FROM revision").fetchone() == (7,)


def test_the_check_of_a_ledger_in_use_says_how_much_is_good(tmp_path):
    path = made(tmp_path / "ledger.sqlite")
    with Ledger(path):
        verdict = inspect(path)
    assert (verdict.code, verdict.good, verdict.forgotten) == ("", 13, 2)


@pytest.mark.parametrize(
    ("statement", "good", "words"),
    [
        (
            "UPDATE revision SET content = replace(content, '3.0', '3.5') WHERE number = 7",
            6,
            "row 7, behind revision 3 of guide (row 6): revision 4 of guide is not what",
        ),
        ("DELETE FROM revision WHERE number = 7", 6, "row 7, behind.*has the number 8"),
        ("UPDATE revision SET chain = x'00' WHERE number = 7", 6, "the chain of hashes breaks"),
        ("UPDATE revision SET feedback_id = 'f99' WHERE number = 7", 6, "is not what was written"),
        ("UPDATE revision SET agent = 'other' WHERE number = 7", 6, "is not what was written"),
        ("UPDATE revision SET feedback_id = 'sha256:0' WHERE number = 3", 12, "forgotten layer"),
        (
            "UPDATE revision SET content = NULL, salt = NULL WHERE number = 13",
            13,
            "forgotten/13 lost its content",
        ),
        ("DROP INDEX revision_of_feedback", 13, "its tables are not those of a ledger"),
        ("DELETE FROM revision WHERE number = 13", 12, "forgotten/13 lost its content"),
    ],
)
def test_what_was_changed_in_a_ledger_is_named(tmp_path, statement, good, words):
    path = made(tmp_path / "ledger.sqlite")
    spoil(path, statement)
    with pytest.raises(LedgerError, match="LEDGER_CORRUPT"):
        Ledger(path)
    verdict = inspect(path)
    assert verdict.good == good
    assert words.split(".*")[0] in verdict.problem


@pytest.mark.parametrize("number", [7, 13])
def test_the_good_revisions_of_a_damaged_ledger_are_saved_into_a_new_one(tmp_path, number):
    path = made(tmp_path / "ledger.sqlite")
    spoil(path, f"UPDATE revision SET digest = x'00', content = '' WHERE number = {number}")
    before = path.read_bytes()
    assert recover(path, tmp_path / "new.sqlite") == number - 1
    assert path.read_bytes() == before
    with Ledger(tmp_path / "new.sqlite") as ledger:
        ages = [row.profile["age"] for row in ledger.history("guide")]
        assert ages == [1.0, *(float(n) for n in range(9))][: number - 3]
        assert ledger.layers("guide") == ()
        assert not ledger.append("guide", {"age": 0.0}, RevisionCause(feedback_id="a1")).profile
    with pytest.raises(Refused, match="FILE_EXISTS"):
        recover(path, tmp_path / "new.sqlite")


def test_a_ledger_without_its_head_is_saved_as_it_is(tmp_path):
    path = made(tmp_path / "ledger.sqlite")
    head_path(path).unlink()
    assert inspect(path).code == "LEDGER_CUT_OFF"
    assert recover(path, tmp_path / "new.sqlite") == 13
    Ledger(tmp_path / "new.sqlite").close()


@pytest.mark.parametrize("kind", ["missing", "text", "folder", "old"])
def test_what_is_no_ledger_is_said_to_be_none(tmp_path, kind):
    path = tmp_path / "ledger.sqlite"
    if kind == "text":
        path.write_text("hello " * 1000)
    elif kind == "folder":
        path.mkdir()
    elif kind == "old":
        old_ledger(path)
    codes = {"text": "LEDGER_CORRUPT", "old": "LEDGER_OLD"}
    with pytest.raises(LedgerError) as error:
        inspect(path)
    assert error.value.code == codes.get(kind, "LEDGER_UNREADABLE")


def test_the_commands_check_and_recover_say_what_they_found(tmp_path):
    path = made(tmp_path / "ledger.sqlite")
    run = CliRunner().invoke
    fine = run(bt_agents, ["profile", "check", str(path)])
    assert (fine.exit_code, fine.output) == (
        0,
        f"{path}: 13 revisions are as they were written, 2 of them without their content, which "
        "was forgotten\n",
    )
    spoil(path, "UPDATE revision SET chain = x'00' WHERE number = 7")
    bad = run(bt_agents, ["profile", "check", str(path)])
    assert bad.exit_code == 1
    assert "LEDGER_CORRUPT: row 7, behind revision 3 of guide (row 6): the chain" in bad.output
    saved = run(bt_agents, ["profile", "recover", str(path), str(tmp_path / "new.sqlite")])
    assert saved.output == f"6 revisions copied to {tmp_path / 'new.sqlite'}\n"


def test_a_ledger_of_format_1_behind_the_head_of_a_rewritten_one_is_not_used(tmp_path):
    path = tmp_path / "ledger.sqlite"
    old_ledger(path)
    with Ledger(path) as ledger:
        ledger.append(
            "guide", {"age": 1.0, "mood": 3.0}, RevisionCause(feedback_id="acknowledged")
        )
    path.unlink()
    old_ledger(path)
    before = [one.read_bytes() for one in (path, head_path(path))]
    words = r"LEDGER_CUT_OFF.*format 1, but 9 revisions of format 2 were acknowledged"
    with pytest.raises(LedgerError, match=words):
        Ledger(path)
    assert [one.read_bytes() for one in (path, head_path(path))] == before


def test_a_ledger_that_was_rewritten_needs_its_log_no_more(tmp_path):
    path = tmp_path / "ledger.sqlite"
    old_ledger(path)
    copy = tmp_path / "copy.sqlite"
    with Ledger(path):
        # Without the log, and with the head.
        copy.write_bytes(path.read_bytes())
        head_path(copy).write_bytes(head_path(path).read_bytes())
    assert inspect(copy).code == ""


def test_a_head_is_never_replaced_by_an_older_one(tmp_path):
    file = HeadFile(tmp_path / "head")
    file.write(Head(number=5, chain=bytes(32)))
    with pytest.raises(ValueError, match="row 4 is to be the newest, but row 5 was acknowledged"):
        file.write(Head(number=4, chain=bytes(32)))
    assert file.head.number == 5
    file.close()


def test_a_change_waits_for_the_disk_once_and_the_head_follows_when_there_is_time(
    tmp_path, monkeypatch
):
    synced = []
    monkeypatch.setattr(commit_marker.os, "fdatasync", synced.append)
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.enter({"guide": {"age": 1.0}})
        ledger.append("guide", {"age": 2.0}, RevisionCause())
        assert read_head(head_path(ledger.path)).number == 2, "whoever reads it finds it"
        assert synced == []
        assert ledger.secure()
        assert ledger.secure()
        assert len(synced) == 1
        ledger.append("guide", {"age": 3.0}, RevisionCause())
        assert ledger.tidy()
        assert len(synced) == 2
        ledger.append("guide", {"age": 4.0}, RevisionCause())
    assert len(synced) == 3


def test_a_head_that_the_disk_did_not_take_is_brought_again(tmp_path, monkeypatch):
    failures = [OSError(errno.EIO, "broken")]

    def sync(_: int) -> None:
        if failures:
            raise failures.pop()

    monkeypatch.setattr(commit_marker.os, "fdatasync", sync)
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.enter({"guide": {"age": 1.0}})
        assert not ledger.tidy()
        assert ledger.tidy()


def test_a_head_that_was_lost_on_its_way_to_the_disk_is_written_anew(tmp_path, monkeypatch):
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        head = head_path(ledger.path)
        before = head.read_bytes()
        ledger.enter({"guide": {"age": 1.0}})

        def lose(file: int) -> None:
            os.pwrite(file, before, 0)
            raise OSError(errno.EIO, "broken")

        with monkeypatch.context() as broken:
            broken.setattr(commit_marker.os, "fdatasync", lose)
            assert not ledger.secure()
        assert read_head(head).number == 0
        assert ledger.secure()
        assert read_head(head).number == 1


def test_what_is_written_after_the_files_were_moved_away_is_not_acknowledged(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({"guide": {"age": 1.0}})
        head = head_path(path)
        head.rename(tmp_path / "away")
        head.write_bytes(b"another")
        with pytest.raises(LedgerError, match=r"LEDGER_FAILED.*stop the node"):
            ledger.append("guide", {"age": 2.0}, RevisionCause())


def test_a_head_of_which_one_slot_is_left_is_written_on(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({"guide": {"age": 1.0}})
    file = HeadFile(head_path(path))
    file.write(file.head)  # now both slots say the same
    file.close()
    with head_path(path).open("r+b") as opened:
        opened.truncate(100)
    with Ledger(path) as ledger:
        ledger.append("guide", {"age": 2.0}, RevisionCause())
        ledger.append("guide", {"age": 3.0}, RevisionCause())
    assert read_head(head_path(path)).number == 3


def test_what_is_written_after_the_head_was_cut_off_is_not_acknowledged(tmp_path):
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.enter({"guide": {"age": 1.0}})
        with head_path(ledger.path).open("r+b") as opened:
            opened.truncate(100)
        with pytest.raises(LedgerError, match=r"LEDGER_FAILED.*cut off; stop the node"):
            ledger.append("guide", {"age": 2.0}, RevisionCause())


def test_a_link_to_a_ledger_is_the_same_ledger(tmp_path):
    path, link = tmp_path / "ledger.sqlite", tmp_path / "elsewhere" / "link"
    link.parent.mkdir()
    link.symlink_to(path)
    with Ledger(path) as ledger:
        ledger.enter({"guide": {"age": 1.0}})
        with pytest.raises(LedgerError, match="LEDGER_IN_USE"):
            Ledger(link)
    with Ledger(link) as ledger:
        assert ledger.current("guide") is not None
    assert list(link.parent.iterdir()) == [link]


def test_a_new_ledger_on_a_full_disk_says_so_and_leaves_nothing_behind(tmp_path, monkeypatch):
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(commit_marker.os, "fsync", full)
    with pytest.raises(LedgerError, match=r"STORAGE_FULL.*make room"):
        Ledger(tmp_path / "ledger.sqlite")
    assert [one.name for one in tmp_path.iterdir()] == ["ledger.sqlite.lock"]
