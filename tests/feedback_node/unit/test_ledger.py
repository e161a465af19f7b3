# SPDX-License-Identifier: Apache-2.0
"""The ledger keeps every revision, applies an id once, and never replaces a damaged file."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing

import pytest

from bt_agents_core.errors import Refused
from feedback_node.ledger import Ledger
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import AUTHORED, FEEDBACK, UNDO, RevisionCause

FIRST = {"age": 4.0, "mood": 3.0}


def cause(feedback_id: str, **fields: object) -> RevisionCause:
    return RevisionCause(feedback_id=feedback_id, source="button", rate=0.2, **fields)  # type: ignore[arg-type]


def profiles(ledger: Ledger, agent: str = "guide") -> list[dict[str, float]]:
    return [dict(row.profile) for row in ledger.history(agent)]


@pytest.fixture
def ledger() -> Iterator[Ledger]:
    with Ledger(":memory:", wall=lambda: 12.5) as ledger:
        yield ledger


def test_an_agent_starts_at_revision_0_with_the_profile_of_its_file(ledger):
    first = ledger.enter({"guide": FIRST})["guide"]
    assert (first.revision, dict(first.profile), first.cause.cause) == (0, FIRST, AUTHORED)
    assert first.stamp == 12.5


def test_entering_the_same_profile_again_writes_nothing(ledger):
    ledger.enter({"guide": FIRST})
    ledger.enter({"guide": dict(FIRST)})
    assert len(ledger.history("guide")) == 1


def test_what_is_appended_is_read_back_with_its_whole_cause(ledger):
    ledger.enter({"guide": FIRST})
    written = cause(
        "f1",
        kind=2,
        reason="too loud",
        epoch="e",
        round=7,
        target={"age": 5.0},
        scene_id="s",
        cancels=True,
    )
    row = ledger.append("guide", {"age": 4.2, "mood": 3.0}, written)
    assert row.revision == 1
    assert ledger.current("guide") == row == ledger.find_all("f1")[0]
    assert row.cause == written


def test_the_same_feedback_id_is_recorded_once(ledger):
    ledger.enter({"guide": FIRST})
    row = ledger.append("guide", {"age": 4.2, "mood": 3.0}, cause("f1"))
    assert ledger.append("guide", {"age": 1.0, "mood": 1.0}, cause("f1")) == row
    assert len(ledger.history("guide")) == 2


def test_changes_without_an_id_do_not_collide(ledger):
    ledger.enter({"guide": FIRST})
    ledger.append("guide", FIRST, RevisionCause())
    assert ledger.append("guide", FIRST, RevisionCause()).revision == 2


def test_an_agent_that_was_never_entered_is_refused(ledger):
    with pytest.raises(Refused, match="UNKNOWN_AGENT"):
        ledger.append("nobody", FIRST, cause("f1"))
    with pytest.raises(Refused, match="UNKNOWN_AGENT"):
        ledger.undo("nobody")


def test_an_edit_of_the_author_wins_over_what_was_learned(ledger):
    ledger.enter({"guide": FIRST})
    ledger.append("guide", {"age": 4.8, "mood": 2.0}, cause("f1"))
    edited = ledger.enter({"guide": {"age": 2.0, "mood": 3.0}})["guide"]
    assert (edited.revision, dict(edited.profile)) == (2, {"age": 2.0, "mood": 3.0})
    assert edited.cause.reason == "the author changed age"
    assert ledger.enter({"guide": {"age": 2.0, "mood": 3.0}})["guide"] == edited


def test_a_new_parameter_takes_the_authored_value_and_the_learned_ones_stay(ledger):
    ledger.enter({"guide": FIRST})
    ledger.append("guide", {"age": 4.8, "mood": 2.0}, cause("f1"))
    grown = {**FIRST, "stress": 1.5}
    row = ledger.enter({"guide": grown})["guide"]
    assert dict(row.profile) == {"age": 4.8, "mood": 2.0, "stress": 1.5}
    assert ledger.enter({"guide": grown})["guide"] == row


def test_a_parameter_that_is_gone_is_dropped_and_the_learned_ones_stay(ledger):
    ledger.enter({"guide": FIRST})
    ledger.append("guide", {"age": 4.8, "mood": 2.0}, cause("f1"))
    assert dict(ledger.enter({"guide": {"age": 4.0}})["guide"].profile) == {"age": 4.8}


def test_undo_goes_back_step_by_step_as_new_revisions(ledger):
    ledger.enter({"guide": FIRST})
    ledger.append("guide", {"age": 4.1, "mood": 3.0}, cause("f1"))
    ledger.append("guide", {"age": 4.2, "mood": 3.0}, cause("f2"))
    ledger.undo("guide")
    ledger.undo("guide", source="studio", reason="wrong button")
    assert [row["age"] for row in profiles(ledger)] == [4.0, 4.1, 4.2, 4.1, 4.0]
    assert [row.cause.cause for row in ledger.history("guide")] == [
        AUTHORED,
        FEEDBACK,
        FEEDBACK,
        UNDO,
        UNDO,
    ]
    assert ledger.history("guide")[-1].cause.reason == "wrong button"


def test_feedback_after_an_undo_is_undone_first(ledger):
    ledger.enter({"guide": FIRST})
    for number, age in enumerate((4.1, 4.2)):
        ledger.append("guide", {"age": age, "mood": 3.0}, cause(f"f{number}"))
    ledger.undo("guide")
    ledger.append("guide", {"age": 4.9, "mood": 3.0}, cause("f9"))
    assert [ledger.undo("guide").profile["age"] for _ in range(2)] == [4.1, 4.0]


def test_what_the_author_wrote_cannot_be_undone(ledger):
    ledger.enter({"guide": FIRST})
    with pytest.raises(Refused, match="NOTHING_TO_UNDO"):
        ledger.undo("guide")
    ledger.append("guide", {"age": 4.1, "mood": 3.0}, cause("f1"))
    ledger.enter({"guide": {"age": 1.0, "mood": 1.0}})
    with pytest.raises(Refused, match="edit the profile there"):
        ledger.undo("guide")


def test_a_profile_that_is_not_finite_is_not_recorded(ledger):
    ledger.enter({"guide": FIRST})
    with pytest.raises(LedgerError, match="LEDGER_FAILED"):
        ledger.append("guide", {"age": float("nan"), "mood": 3.0}, cause("f1"))
    assert len(ledger.history("guide")) == 1
    assert ledger.append("guide", FIRST, cause("f1")).revision == 1


def test_one_bad_entry_of_many_records_none(ledger):
    with pytest.raises(LedgerError):
        ledger.enter({"guide": FIRST, "express": {"age": float("inf")}})
    assert ledger.current("guide") is None


def test_a_closed_file_opens_again_with_every_revision(tmp_path):
    path = tmp_path / "state" / "deep" / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
        ledger.append("guide", {"age": 0.1 + 0.2, "mood": 3.0}, cause("f1"))
        written = ledger.history("guide")
    with Ledger(path) as again:
        assert again.history("guide") == written


def test_rows_cannot_be_changed_or_deleted_from_outside(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
        other = sqlite3.connect(path)
        for statement in (
            "UPDATE revision SET content = '{}'",
            "UPDATE revision SET revision = 9, content = NULL",
            "DELETE FROM revision",
        ):
            with pytest.raises(sqlite3.IntegrityError, match="append a new one"):
                other.execute(statement)
        other.close()


def test_a_commit_is_synchronous_and_readers_are_not_locked_out(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        database = ledger._database
        assert database.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert database.execute("PRAGMA synchronous").fetchone() == (2,)
        ledger.enter({"guide": FIRST})
        reader = sqlite3.connect(path)
        assert reader.execute("SELECT count(*) FROM revision").fetchone() == (1,)
        reader.close()


def test_a_second_writer_is_kept_out_until_the_first_closes(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path), pytest.raises(LedgerError, match="LEDGER_IN_USE"):
        Ledger(path)
    Ledger(path).close()


def test_two_writers_whose_lock_was_removed_are_told_of_each_other(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as first:
        first.enter({"guide": {"age": 1.0}})
        first.append("guide", {"age": 2.0}, cause("1"))
        (tmp_path / "ledger.sqlite.lock").unlink()
        with Ledger(path) as second:
            second.append("guide", {"age": 3.0}, cause("2"))
            with pytest.raises(LedgerError) as conflict:
                first.append("guide", {"age": 4.0}, cause("3"))
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(LedgerError) as busy:
            first.append("guide", {"age": 4.0}, cause("3"))
        other.close()
        assert [row["age"] for row in profiles(first)] == [1.0, 2.0, 3.0]
    for error in (conflict, busy):
        assert error.value.code == "LEDGER_IN_USE"
        assert f"as its lock {path}.lock was removed" in error.value.reason
        assert "disk" not in error.value.reason


def test_a_ledger_is_private_with_its_logs_and_its_lock_and_an_old_one_is_tightened(tmp_path):
    path = tmp_path / "state" / "ledger.sqlite"
    for _ in range(2):
        with Ledger(path) as ledger:
            ledger.enter({"guide": {"age": 1.0}})
            files = sorted(path.parent.iterdir())
            assert [file.suffix for file in files] == [
                ".sqlite",
                ".sqlite-shm",
                ".sqlite-wal",
                ".lock",
            ]
            assert {file.stat().st_mode & 0o777 for file in files} == {0o600}
            assert path.parent.stat().st_mode & 0o777 == 0o700
            for file in files:
                file.chmod(0o644)


def test_a_file_that_is_no_database_is_named_and_left_alone(tmp_path):
    path = tmp_path / "ledger.sqlite"
    path.write_bytes(b"this is no database, but long enough to look at" * 50)
    before = path.read_bytes()
    with pytest.raises(LedgerError) as error:
        Ledger(path)
    assert error.value.code == "LEDGER_CORRUPT"
    assert str(path) in error.value.reason
    assert "move the file away" in error.value.reason
    assert path.read_bytes() == before


def test_a_damaged_page_is_noticed_at_the_start(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({f"agent{number}": FIRST for number in range(300)})
    content = bytearray(path.read_bytes())
    content[4096 * 3 : 4096 * 5] = b"\xa5" * 8192
    path.write_bytes(content)
    with pytest.raises(LedgerError, match="LEDGER_CORRUPT"):
        Ledger(path)
    assert path.read_bytes() == bytes(content)


@pytest.mark.parametrize("number", [2, 4])
def test_another_format_is_left_alone(tmp_path, number):
    path = tmp_path / "ledger.sqlite"
    Ledger(path).close()
    with closing(sqlite3.connect(path)) as database:
        database.execute(f"PRAGMA user_version = {number}")
    before = path.read_bytes()
    with pytest.raises(LedgerError, match=f"format {number}, this program knows 3 only") as error:
        Ledger(path)
    assert error.value.code == "OTHER_FORMAT"
    assert path.read_bytes() == before


def test_a_database_of_another_program_is_left_alone(tmp_path):
    path = tmp_path / "ledger.sqlite"
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE bookmarks (url TEXT)")
    database.close()
    with pytest.raises(LedgerError, match="LEDGER_FOREIGN"):
        Ledger(path)


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(LedgerError, match="LEDGER_UNREADABLE"):
        Ledger(tmp_path / "file" / "ledger.sqlite")
    (tmp_path / "folder.sqlite").mkdir()
    with pytest.raises(LedgerError, match="LEDGER_UNREADABLE"):
        Ledger(tmp_path / "folder.sqlite")


def test_a_row_with_a_damaged_profile_is_named(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
    database = sqlite3.connect(path)
    trigger = database.execute(
        "SELECT sql FROM sqlite_master WHERE name = 'revision_no_update'"
    ).fetchone()[0]
    database.execute("DROP TRIGGER revision_no_update")
    database.execute("UPDATE revision SET content = replace(content, '4.0', '4.5')")
    database.execute(trigger)
    database.commit()
    database.close()
    with pytest.raises(LedgerError, match=r"row 1 \(revision 0 of guide\) is not what was"):
        Ledger(path)


def test_a_row_that_is_changed_while_the_ledger_is_open_is_not_believed(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
        database = sqlite3.connect(path)
        database.execute("DROP TRIGGER revision_no_update")
        database.execute("UPDATE revision SET content = replace(content, '4.0', '4.5')")
        database.commit()
        database.close()
        with pytest.raises(LedgerError, match="LEDGER_CORRUPT"):
            ledger.current("guide")


_WRITER = """
import itertools, sys
from feedback_node.ledger import Ledger
from feedback_node.ledger.rows import RevisionCause
ledger = Ledger(sys.argv[1])
ledger.enter({"guide": {"age": 0.0}})
for number in itertools.count(1):
    row = ledger.append("guide", {"age": float(number)}, RevisionCause(feedback_id=f"f{number}"))
    print(row.revision, flush=True)
"""


def test_every_acknowledged_revision_survives_kill_9(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with subprocess.Popen(
        [sys.executable, "-c", _WRITER, str(path)], stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        for _ in range(20):
            child.stdout.readline()
        child.kill()
        rest = child.stdout.read().split("\n")
    acknowledged = 20 + len([line for line in rest[:-1] if line])
    with Ledger(path) as ledger:
        ages = [row.profile["age"] for row in ledger.history("guide")]
    assert len(ages) >= acknowledged + 1
    assert ages == [float(number) for number in range(len(ages))]


def test_a_tidy_ledger_has_nothing_left_to_write_when_it_is_closed(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({"guide": {"age": 3.0}})
        log = path.with_name(path.name + "-wal")
        assert log.stat().st_size > 0
        ledger.checkpoint()
        # What a reader of the database file alone sees, with the log out of the way.
        alone = tmp_path / "alone.sqlite"
        alone.write_bytes(path.read_bytes())
        with closing(sqlite3.connect(alone)) as database:
            assert database.execute("SELECT count(*) FROM revision").fetchone() == (1,)
