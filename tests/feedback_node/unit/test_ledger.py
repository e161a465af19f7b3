# SPDX-License-Identifier: Apache-2.0
"""The ledger: keeps every revision, applies an id once, never replaces a damaged file."""

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
        ledger.enter({"guide": FIRST})
        yield ledger


def test_agent_starts_at_revision_0_with_authored_profile(ledger):
    first = ledger.current("guide")
    assert (first.revision, dict(first.profile), first.cause.cause) == (0, FIRST, AUTHORED)
    assert first.stamp == 12.5


def test_appended_revision_is_read_back_with_full_cause(ledger):
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


def test_changes_without_id_do_not_collide(ledger):
    ledger.append("guide", FIRST, RevisionCause())
    assert ledger.append("guide", FIRST, RevisionCause()).revision == 2


def test_agent_never_entered_is_rejected(ledger):
    with pytest.raises(Refused, match="UNKNOWN_AGENT"):
        ledger.append("nobody", FIRST, cause("f1"))
    with pytest.raises(Refused, match="UNKNOWN_AGENT"):
        ledger.undo("nobody")


def test_author_edit_overrides_learned_values(ledger):
    ledger.append("guide", {"age": 4.8, "mood": 2.0}, cause("f1"))
    edited = ledger.enter({"guide": {"age": 2.0, "mood": 3.0}})["guide"]
    assert (edited.revision, dict(edited.profile)) == (2, {"age": 2.0, "mood": 3.0})
    assert edited.cause.reason == "the author changed age"
    assert ledger.enter({"guide": {"age": 2.0, "mood": 3.0}})["guide"] == edited


@pytest.mark.parametrize(
    ("authored", "profile"),
    [
        ({**FIRST, "stress": 1.5}, {"age": 4.8, "mood": 2.0, "stress": 1.5}),
        ({"age": 4.0}, {"age": 4.8}),
    ],
)
def test_changed_parameters_keep_learned_values_of_others(ledger, authored, profile):
    ledger.append("guide", {"age": 4.8, "mood": 2.0}, cause("f1"))
    row = ledger.enter({"guide": authored})["guide"]
    assert dict(row.profile) == profile
    assert ledger.enter({"guide": authored})["guide"] == row


def test_undo_steps_back_through_new_revisions(ledger):
    ledger.append("guide", {"age": 4.1, "mood": 3.0}, cause("f1"))
    ledger.append("guide", {"age": 4.2, "mood": 3.0}, cause("f2"))
    ledger.undo("guide")
    ledger.undo("guide", source="studio", reason="wrong button")
    assert [row["age"] for row in profiles(ledger)] == [4.0, 4.1, 4.2, 4.1, 4.0]
    causes = [row.cause.cause for row in ledger.history("guide")]
    assert causes == [AUTHORED, FEEDBACK, FEEDBACK, UNDO, UNDO]
    assert ledger.history("guide")[-1].cause.reason == "wrong button"


def test_feedback_after_undo_is_undone_first(ledger):
    for number, age in enumerate((4.1, 4.2)):
        ledger.append("guide", {"age": age, "mood": 3.0}, cause(f"f{number}"))
    ledger.undo("guide")
    ledger.append("guide", {"age": 4.9, "mood": 3.0}, cause("f9"))
    assert [ledger.undo("guide").profile["age"] for _ in range(2)] == [4.1, 4.0]


def test_authored_profile_cannot_be_undone(ledger):
    with pytest.raises(Refused, match="NOTHING_TO_UNDO"):
        ledger.undo("guide")
    ledger.append("guide", {"age": 4.1, "mood": 3.0}, cause("f1"))
    ledger.enter({"guide": {"age": 1.0, "mood": 1.0}})
    with pytest.raises(Refused, match="edit the profile there"):
        ledger.undo("guide")


def test_non_finite_profile_is_not_recorded(ledger):
    with pytest.raises(LedgerError, match="LEDGER_FAILED"):
        ledger.append("guide", {"age": float("nan"), "mood": 3.0}, cause("f1"))
    assert len(ledger.history("guide")) == 1
    assert ledger.append("guide", FIRST, cause("f1")).revision == 1


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE revision SET content = '{}'",
        "UPDATE revision SET revision = 9, content = NULL",
        "DELETE FROM revision",
    ],
)
def test_external_updates_and_deletes_are_blocked(path, statement):
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
        with (
            closing(sqlite3.connect(path)) as other,
            pytest.raises(sqlite3.IntegrityError, match="append a new one"),
        ):
            other.execute(statement)


def test_commit_is_synchronous_and_does_not_block_readers(path):
    with Ledger(path) as ledger:
        database = ledger._database
        assert database.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert database.execute("PRAGMA synchronous").fetchone() == (2,)
        ledger.enter({"guide": FIRST})
        with closing(sqlite3.connect(path)) as reader:
            assert reader.execute("SELECT count(*) FROM revision").fetchone() == (1,)


def test_second_writer_is_locked_out_until_first_closes(path):
    with Ledger(path), pytest.raises(LedgerError, match="LEDGER_IN_USE"):
        Ledger(path)
    Ledger(path).close()


def test_writers_detect_each_other_after_lock_removal(path, tmp_path):
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


def test_ledger_files_are_private_including_existing_ones(tmp_path):
    path = tmp_path / "state" / "deep" / "ledger.sqlite"
    for _ in range(2):
        with Ledger(path) as ledger:
            ledger.enter({"guide": {"age": 1.0}})
            files = sorted(path.parent.iterdir())
            suffixes = [file.suffix for file in files]
            assert suffixes == [".sqlite", ".sqlite-shm", ".sqlite-wal", ".lock"]
            assert {file.stat().st_mode & 0o777 for file in files} == {0o600}
            assert path.parent.stat().st_mode & 0o777 == 0o700
            for file in files:
                file.chmod(0o644)


def test_unwritable_path_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(LedgerError, match="LEDGER_UNREADABLE"):
        Ledger(tmp_path / "file" / "ledger.sqlite")


def test_row_altered_while_open_is_detected(path):
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
        with closing(sqlite3.connect(path)) as database, database:
            database.execute("DROP TRIGGER revision_no_update")
            database.execute("UPDATE revision SET content = replace(content, '4.0', '4.5')")
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


def test_acknowledged_revisions_survive_kill_9(path):
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


def test_checkpoint_leaves_nothing_to_write_on_close(path, tmp_path):
    with Ledger(path) as ledger:
        ledger.enter({"guide": {"age": 3.0}})
        log = path.with_name(path.name + "-wal")
        assert log.stat().st_size > 0
        ledger.checkpoint()
        # The view of a reader of the database file alone, with the log moved away.
        alone = tmp_path / "alone.sqlite"
        alone.write_bytes(path.read_bytes())
        with closing(sqlite3.connect(alone)) as database:
            assert database.execute("SELECT count(*) FROM revision").fetchone() == (1,)
