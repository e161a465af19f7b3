# SPDX-License-Identifier: Apache-2.0
"""Layers in the ledger: their feedback, and complete removal."""

from __future__ import annotations

import shutil
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from bt_agents_core.errors import Refused
from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import LAYER, RevisionCause

ANNA = "person/anna"
FIRST = {"age": 4.0, "mood": 3.0}


@pytest.fixture
def ledger() -> Iterator[Ledger]:
    with Ledger(":memory:") as ledger:
        ledger.enter({"guide": FIRST})
        yield ledger


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


def test_author_edit_changes_only_edited_values_in_layers(ledger):
    begin(ledger)
    ledger.append("guide", {"age": 4.8, "mood": 1.5}, RevisionCause(), layer=ANNA)
    ledger.enter({"guide": {"age": 2.0, "mood": 3.0}})
    assert dict(ledger.layers("guide")[0].profile) == {"age": 2.0, "mood": 1.5}
    ledger.enter({"guide": {"age": 2.0, "mood": 3.0, "stress": 1.0}})
    assert dict(ledger.layers("guide")[0].profile) == {"age": 2.0, "mood": 1.5, "stress": 1.0}


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


def test_open_reader_delays_erasure_until_it_closes(path):
    with Ledger(path) as ledger:
        ledger.enter({"guide": FIRST})
        begin(ledger)
        with read(path):
            assert ledger.forget([("guide", ANNA)])
            assert not ledger.checkpoint()
            assert traces(path, "anna")
        assert ledger.checkpoint()
        assert traces(path, "anna") == []


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
