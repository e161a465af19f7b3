# SPDX-License-Identifier: Apache-2.0
"""The ledger: keeps every revision, applies an id once, and erases layers completely."""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from bt_agents_core.errors import Refused
from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import AUTHORED, FEEDBACK, LAYER, UNDO, RevisionCause

FIRST = {"age": 4.0, "mood": 3.0}
ANNA = "person/anna"


def cause(feedback_id: str, **fields: object) -> RevisionCause:
    return RevisionCause(feedback_id=feedback_id, source="button", rate=0.2, **fields)  # type: ignore[arg-type]


@pytest.fixture
def ledger() -> Iterator[Ledger]:
    with Ledger(":memory:", wall=lambda: 12.5) as ledger:
        ledger.enter({"guide": FIRST})
        yield ledger


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
    assert (row.revision, row.stamp) == (1, 12.5)
    assert ledger.current("guide") == row == ledger.find_all("f1")[0]
    assert row.cause == written


def test_agent_never_entered_is_rejected(ledger):
    with pytest.raises(Refused, match="UNKNOWN_AGENT"):
        ledger.append("nobody", FIRST, cause("f1"))
    with pytest.raises(Refused, match="UNKNOWN_AGENT"):
        ledger.undo("nobody")


@pytest.mark.parametrize(
    ("authored", "profile"),
    [
        ({**FIRST, "stress": 1.5}, {"age": 4.8, "mood": 2.0, "stress": 1.5}),
        ({"age": 4.0}, {"age": 4.8}),
    ],
)
def test_changed_parameters_keep_learned_values_of_others(ledger, authored, profile):
    for layer in ("", ANNA):
        ledger.append("guide", {"age": 4.8, "mood": 2.0}, RevisionCause(), layer=layer)
    row = ledger.enter({"guide": authored})["guide"]
    assert dict(row.profile) == dict(ledger.layers("guide")[0].profile) == profile
    assert ledger.enter({"guide": authored})["guide"] == row


def test_undo_steps_back_through_new_revisions(ledger):
    ledger.append("guide", {"age": 4.1, "mood": 3.0}, cause("f1"))
    ledger.append("guide", {"age": 4.2, "mood": 3.0}, cause("f2"))
    ledger.undo("guide")
    ledger.undo("guide", source="studio", reason="wrong button")
    assert ages(ledger) == [4.0, 4.1, 4.2, 4.1, 4.0]
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
    assert ages(ledger) == [4.0]
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
        assert ages(first) == [1.0, 2.0, 3.0]
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
from feedback_node.ledger import Ledger, LedgerEntry
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
        for _ in range(20):
            child.stdout.readline()
        child.kill()
        rest = child.stdout.read().split("\n")
    acknowledged = 20 + len([line for line in rest[:-1] if line])
    with Ledger(path) as ledger:
        found = ages(ledger)
    assert len(found) >= acknowledged + 1
    assert found == [float(number) for number in range(len(found))]


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


# --- layers ---------------------------------------------------------------------------------


def begin(ledger: Ledger, layer: str = ANNA, **first: float) -> None:
    profile = {**FIRST, **first}
    ledger.append("guide", profile, RevisionCause(cause=LAYER), layer=layer)


def teach(ledger: Ledger, feedback_id: str, layer: str = "", age: float = 5.0) -> None:
    cause = RevisionCause(feedback_id=feedback_id, reason=f"because of {feedback_id}")
    ledger.append("guide", {"age": age, "mood": 3.0}, cause, layer=layer)


def ages(ledger: Ledger, layer: str = "") -> list[float]:
    return [row.profile["age"] for row in ledger.history("guide", layer)]


@contextmanager
def read(path: Path) -> Iterator[None]:
    """Read the file of a ledger, like another program, until the end of the block."""
    with closing(sqlite3.connect(path, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM revision").fetchone()
        yield


def test_several_layers_are_recorded_atomically(ledger):
    good = LedgerEntry(agent="guide", profile=FIRST, cause=RevisionCause(feedback_id="f"))
    bad = replace(good, layer=ANNA, profile={"age": float("nan")})
    with pytest.raises(LedgerError):
        ledger.record([good, bad])
    assert (ages(ledger), ledger.layers("guide"), ledger.find_all("f")) == ([4.0], (), ())


def test_feedback_id_of_several_layers_returns_all_revisions(ledger):
    begin(ledger)
    entry = LedgerEntry(agent="guide", profile=FIRST, cause=RevisionCause(feedback_id="f"))
    entries = [replace(entry, layer=layer) for layer in (ANNA, "")]
    recorded = ledger.record(entries)
    assert ledger.record(entries) == recorded == ledger.find_all("f")
    assert [row.layer for row in recorded] == [ANNA, ""]


def test_undo_of_layer_stops_at_its_beginning(ledger):
    begin(ledger, age=4.5)
    teach(ledger, "f1", ANNA)
    assert ledger.undo("guide", ANNA).profile["age"] == 4.5
    with pytest.raises(Refused, match="revision 0 is where the layer begins"):
        ledger.undo("guide", ANNA)
    with pytest.raises(Refused, match="UNKNOWN_LAYER: guide has no layer 'person/bob'; it has:"):
        ledger.undo("guide", "person/bob")


def test_reset_restores_authored_profile_and_can_be_undone(ledger):
    teach(ledger, "f1")
    row = ledger.reset("guide", source="anna", reason="enough")
    assert (dict(row.profile), row.cause.changes) == (FIRST, 0)
    assert ledger.taught("guide", newest=9) == ()
    assert ledger.undo("guide").profile["age"] == 5.0
    assert [one.cause.feedback_id for one in ledger.taught("guide", newest=9)] == ["f1"]


def test_undone_feedback_does_not_count_as_taught(ledger):
    for number in range(4):
        teach(ledger, f"f{number}")
    ledger.undo("guide")
    ledger.undo("guide")
    teach(ledger, "f9")
    taught = [row.cause.feedback_id for row in ledger.taught("guide", newest=9)]
    assert taught == ["f0", "f1", "f9"]
    assert [row.cause.feedback_id for row in ledger.taught("guide", newest=2)] == ["f1", "f9"]


def traces(path: Path, *words: str) -> list[str]:
    content = b"".join(part.read_bytes() for part in path.parent.iterdir())
    return [word for word in words if word.encode() in content]


def test_forgotten_layer_leaves_no_trace_in_any_file(path):
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST, "express": FIRST})
        begin(ledger)
        # Enough to split pages, partly in the file, partly in the log.
        for number in range(150):
            teach(ledger, f"secret-{number}", ANNA, age=1.2345678)
            teach(ledger, f"other-{number}")
            if number == 100:
                ledger.checkpoint()
        assert traces(path, "anna", "secret-7", "because of secret", "1.2345678")
        assert ledger.forget([("guide", ANNA)], source="the operator") == ""
        assert traces(path, "anna", "secret-", "because of secret", "1.2345678") == []
        assert len(ledger.history("guide")) == 151
    with Ledger(path) as ledger:
        assert ledger.layers("guide") == ()
        assert len(ledger.history("guide")) == 151


def test_general_profile_cannot_be_forgotten(ledger):
    with pytest.raises(Refused, match="UNKNOWN_LAYER"):
        ledger.forget([("guide", "")])
    begin(ledger)
    with pytest.raises(Refused, match="UNKNOWN_LAYER: guide has no layer 'person/bob'"):
        ledger.forget([("guide", ANNA), ("guide", "person/bob")])
    assert ages(ledger, ANNA) == [4.0]


def test_next_start_completes_erasure_after_crash(tmp_path):
    path = tmp_path / "before" / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
        begin(ledger)
        with read(path):
            ledger.forget([("guide", ANNA)])
            shutil.copytree(path.parent, tmp_path / "after")
    after = tmp_path / "after" / "ledger.sqlite"
    assert traces(after, "anna")
    with Ledger(after) as ledger:
        ledger.checkpoint()
        assert traces(after, "anna") == []


def test_open_reader_does_not_grow_log_during_erasure(path):
    log = path.with_name(path.name + "-wal")
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
        begin(ledger)
        for number in range(50):
            teach(ledger, f"long{number}" * 100)
        with read(path):
            assert ledger.forget([("guide", ANNA)])
            size = log.stat().st_size
            begun = time.perf_counter()
            assert [ledger.checkpoint() for _ in range(5)] == [False] * 5
            # Otherwise each would wait half a second for the reader.
            assert time.perf_counter() - begun < 1.5
            assert log.stat().st_size == size
        assert ledger.checkpoint()
        assert traces(path, "anna") == []


def test_failed_erasure_is_retried_with_growing_intervals(tmp_path):
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.enter({"guide": FIRST})
        begin(ledger)
        tried = []
        # Like a refusal by a full disk.
        ledger._database.set_authorizer(lambda *_: sqlite3.SQLITE_OK)
        ledger._erasure.run = lambda: tried.append(True) or "full"
        assert ledger.forget([("guide", ANNA)]) == "full"
        del tried[:]
        for _ in range(200):
            assert not ledger.checkpoint()
        assert len(tried) == 8
        del ledger._erasure.run
        while not ledger.checkpoint():
            pass


def test_layer_count_excludes_forgotten_layers(ledger):
    for name in ("anna", "bob", "carl"):
        begin(ledger, f"person/{name}")
        teach(ledger, name, f"person/{name}")
    ledger.forget([("guide", "person/bob")])
    assert ledger.count_layers("guide") == len(ledger.layers("guide")) == 2
    assert ledger.count_layers("nobody") == 0


def test_feedback_is_counted_once_for_all_layers(ledger):
    begin(ledger)
    for feedback_id in ("s/1/a", "s/1/b", "s/2/a", "s"):
        teach(ledger, feedback_id, ANNA)
        teach(ledger, feedback_id)
    counts = [ledger.count(prefix) for prefix in ("s/1/", "s/", "t")]
    assert counts == [{"guide": 2}, {"guide": 3}, {}]


def test_authored_profile_is_cached_and_survives_failed_edit(ledger):
    for number in range(100):
        teach(ledger, f"f{number}")
    read = []
    select = ledger._select
    ledger._select = lambda *args: read.append(select(*args)) or read[-1]
    ledger._authored.clear()
    assert ledger.authored("guide") == FIRST
    assert [len(rows) for rows in read] == [1]
    assert (ledger.authored("guide"), len(read)) == (FIRST, 1)
    bad = {"guide": {"age": 1.0, "mood": 3.0}, "new": {"age": float("nan")}}
    with pytest.raises(LedgerError):
        ledger.enter(bad)
    assert ledger.authored("guide") == FIRST
    ledger.enter({"guide": {"age": 1.0, "mood": 3.0}})
    assert ledger.authored("guide") == {"age": 1.0, "mood": 3.0}
