# SPDX-License-Identifier: Apache-2.0
"""Check and recovery of a ledger, and the place of its files."""

from __future__ import annotations

import errno
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner

from bt_agents_core.errors import Refused
from bt_agents_tools.cli.main import bt_agents
from feedback_node.ledger import Ledger
from feedback_node.ledger.file import LedgerError, inspect, recover
from feedback_node.ledger.rows import LAYER, RevisionCause

ANNA = "person/anna"
PAGE = 4096
LEAF_OF_TABLE = 13
"""First byte of a leaf page of a table."""


def made(path: Path) -> Path:
    """Write a ledger of 13 rows, with a forgotten layer and the row about it at the end."""
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


ROW_7 = "row 7 (revision 4 of guide) is damaged"
GAP = "revision 4 of guide is missing before row 8"
NO_TABLES = "its tables are not the tables of a ledger"


@pytest.mark.parametrize(
    ("statement", "good", "problems"),
    [
        *(
            (f"UPDATE revision SET {change} WHERE number = 7", 7, [ROW_7])
            for change in (
                "content = replace(content, '3.0', '3.5')",
                "checksum = checksum + 1",
                "feedback_id = 'f99'",
                "content = CAST(x'ff' || content AS TEXT)",
                "content = CAST(content AS BLOB)",
            )
        ),
        (
            "UPDATE revision SET content = '' WHERE number IN (7, 9)",
            7,
            [ROW_7, "row 9 (revision 6 of guide) is damaged"],
        ),
        ("DELETE FROM revision WHERE number = 7", 7, [GAP]),
        (
            "UPDATE revision SET agent = 'other' WHERE number = 7",
            7,
            ["row 7 (revision 4 of other) is damaged", GAP],
        ),
        (
            "UPDATE revision SET feedback_id = 'sha256:0' WHERE number = 3",
            11,
            ["row 3 (revision 1 of guide for forgotten/2) is damaged"],
        ),
        (
            "UPDATE revision SET content = NULL WHERE number = 13",
            12,
            ["row 13 (revision 2 of guide for forgotten/2) is damaged"],
        ),
        ("DROP INDEX revision_of_feedback", 13, [NO_TABLES]),
        ("DROP TABLE pending", 13, [NO_TABLES]),
    ],
)
def test_altered_ledger_content_is_reported(path, statement, good, problems):
    made(path)
    spoil(path, statement)
    with pytest.raises(LedgerError, match="LEDGER_CORRUPT") as error:
        Ledger(path)
    assert "; ".join(problems) in error.value.reason
    report = inspect(str(path))
    assert (report.good, list(report.problems)) == (good, problems)


def test_damaged_page_reports_rows_and_others_are_recovered(tmp_path):
    path, new = tmp_path / "ledger.sqlite", tmp_path / "new.sqlite"
    agents = [f"agent{number}" for number in range(200)]
    with Ledger(path) as ledger:
        ledger.enter({agent: {"age": 1.0} for agent in agents})
    content = bytearray(path.read_bytes())
    leaves = [at for at in range(PAGE, len(content), PAGE) if content[at] == LEAF_OF_TABLE]
    [leaf] = [at for at in leaves if b"agent100" in content[at : at + PAGE]]
    content[leaf : leaf + PAGE] = b"\xa5" * PAGE
    path.write_bytes(content)
    with pytest.raises(LedgerError, match="LEDGER_CORRUPT"):
        Ledger(path)
    report = inspect(str(path))
    first, _, last = report.problems[0].split()[1:4]
    assert report.problems[0].startswith(f"rows {first} to {last} cannot be read")
    lost = range(int(first), int(last) + 1)
    assert 0 < len(lost) == len(agents) - report.good
    assert recover(str(path), str(new)) == report.good
    with Ledger(new) as ledger:
        saved = [agent for number, agent in enumerate(agents, start=1) if number not in lost]
        assert set(ledger.agents()) == set(saved)


def test_ledger_without_its_last_page_is_recovered(tmp_path):
    path = made(tmp_path / "ledger.sqlite")
    rows = inspect(str(path)).good
    path.write_bytes(path.read_bytes()[:-PAGE])
    report = inspect(str(path))
    assert report.good == rows
    assert report.problems
    assert recover(str(path), str(tmp_path / "new.sqlite")) == rows


@pytest.mark.parametrize(("number", "saved", "revisions"), [(7, 7, 4), (13, 12, 10)])
def test_good_revisions_are_recovered_into_new_ledger(tmp_path, number, saved, revisions):
    path, new = made(tmp_path / "ledger.sqlite"), tmp_path / "new.sqlite"
    spoil(path, f"UPDATE revision SET content = '' WHERE number = {number}")
    before = path.read_bytes()
    assert recover(str(path), str(new)) == saved
    assert path.read_bytes() == before
    with Ledger(new) as ledger:
        ages = [row.profile["age"] for row in ledger.history("guide")]
        assert ages == [1.0, *(float(n) for n in range(9))][:revisions]
        assert ledger.layers("guide") == ()
        assert not ledger.append("guide", {"age": 0.0}, RevisionCause(feedback_id="a1")).profile
    with pytest.raises(Refused, match="FILE_EXISTS"):
        recover(str(path), str(new))


def test_forgetting_works_in_recovered_ledger_with_forgotten_rows(tmp_path):
    path, new = made(tmp_path / "ledger.sqlite"), tmp_path / "new.sqlite"
    spoil(path, "DELETE FROM revision WHERE number BETWEEN 4 AND 13")
    assert recover(str(path), str(new)) == 3
    with Ledger(new) as ledger:
        for number in range(20):
            ledger.append("guide", {"age": 1.0}, RevisionCause(cause=LAYER), layer=ANNA)
            assert ledger.forget([("guide", ANNA)]) == "", number
    assert not inspect(str(new)).problems


@pytest.mark.parametrize("read", [Ledger, inspect])
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("text", "LEDGER_CORRUPT: .*move the file away"),
        ("folder", "LEDGER_UNREADABLE: "),
        ("foreign", "LEDGER_FOREIGN: "),
        ("2", "OTHER_FORMAT: .*format 2, this program knows 3 only"),
        ("4", "OTHER_FORMAT: .*format 4, this program knows 3 only"),
    ],
)
def test_non_ledger_is_reported_and_left_unchanged(path, kind, words, read):
    if kind == "text":
        path.write_text("this is not a database, but long enough to look at" * 50)
    elif kind == "folder":
        path.mkdir()
    else:
        if kind != "foreign":
            Ledger(path).close()
        with closing(sqlite3.connect(path)) as database:
            statement = f"PRAGMA user_version = {kind}"
            database.execute("CREATE TABLE own (a)" if kind == "foreign" else statement)
    before = path.is_file() and path.read_bytes()
    with pytest.raises(LedgerError, match=words) as error:
        read(str(path))
    assert str(path) in error.value.reason
    assert (path.is_file() and path.read_bytes()) == before


def test_check_of_missing_ledger_is_refused(path):
    with pytest.raises(LedgerError, match="LEDGER_UNREADABLE"):
        inspect(str(path))


def test_check_and_recover_commands_report_their_findings(path, tmp_path):
    made(path)
    run = CliRunner().invoke
    fine = run(bt_agents, ["profile", "check", str(path)])
    what = "are as they were written, 2 of them without their content, which was forgotten"
    assert (fine.exit_code, fine.output) == (0, f"{path}: 13 revisions {what}\n")
    spoil(path, "UPDATE revision SET checksum = 0 WHERE number = 7")
    bad = run(bt_agents, ["profile", "check", str(path)])
    assert bad.exit_code == 1
    assert "LEDGER_CORRUPT: row 7 (revision 4 of guide) is damaged\n" in bad.output
    saved = run(bt_agents, ["profile", "recover", str(path), str(tmp_path / "new.sqlite")])
    assert saved.output == f"7 revisions copied to {tmp_path / 'new.sqlite'}\n"


def test_check_command_lists_first_problems_and_counts_others(path):
    with Ledger(path) as ledger:
        ledger.enter({f"agent{number}": {"age": 1.0} for number in range(25)})
    spoil(path, "UPDATE revision SET checksum = 0")
    with pytest.raises(LedgerError, match=r"row 3 \(revision 0 of agent2\).*; and 22 more\. "):
        Ledger(path)
    bad = CliRunner().invoke(bt_agents, ["profile", "check", str(path)])
    assert bad.output.count("LEDGER_CORRUPT") == 20
    assert "and 5 problems more" in bad.output


def test_log_without_its_ledger_is_not_replaced(path):
    log = path.with_name("ledger.sqlite-wal")
    with Ledger(path) as ledger:
        ledger.enter({"guide": {"age": 1.0}})
        content = log.read_bytes()
    path.unlink()
    log.write_bytes(content)
    with pytest.raises(LedgerError, match=r"LEDGER_CORRUPT.*its log \(-wal\) is there"):
        Ledger(path)
    assert log.read_bytes() == content


def test_symlink_to_ledger_is_the_same_ledger(tmp_path):
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


def test_new_ledger_on_full_disk_reports_storage_full(tmp_path, monkeypatch):
    def full(_: object) -> None:
        error = sqlite3.OperationalError("database or disk is full")
        error.sqlite_errorcode = sqlite3.SQLITE_FULL
        raise error

    monkeypatch.setattr("feedback_node.ledger.file.create_tables", full)
    with pytest.raises(LedgerError, match=r"STORAGE_FULL.*make room"):
        Ledger(tmp_path / "ledger.sqlite")
    monkeypatch.undo()
    Ledger(tmp_path / "ledger.sqlite").close()


def test_inaccessible_folder_is_reported(tmp_path, monkeypatch):
    def denied(_: Path) -> bool:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "exists", denied)
    with pytest.raises(LedgerError, match=r"LEDGER_UNREADABLE.*Permission denied"):
        Ledger(tmp_path / "ledger.sqlite")
