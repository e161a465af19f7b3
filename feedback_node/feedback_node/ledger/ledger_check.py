# SPDX-License-Identifier: Apache-2.0
"""Whether a ledger says what was written: its layout, each row, the chain, and its head."""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from feedback_node.ledger.commit_marker import Head, head_path, read_head
from feedback_node.ledger.ledger_layout import structure_problem
from feedback_node.ledger.ledger_rows import (
    COLUMNS,
    FORGOTTEN,
    FORGOTTEN_LAYER,
    NO_CHAIN,
    Damaged,
    Row,
    chained,
    check_content,
    name_of,
    read_row,
    rest_of,
)

LOCK_WAIT_S = 0.5

CORRUPT = "LEDGER_CORRUPT"
CUT_OFF = "LEDGER_CUT_OFF"

MEND = (
    "Nothing was changed. 'bt-agents profile recover' copies the good revisions into a new file; "
    "or put a copy back; or move the file away, with its -wal, -shm and -head, to start with the "
    "profiles of the agents' files"
)


@dataclass(frozen=True, kw_only=True)
class LedgerReport:
    """What a check of a ledger has found.

    Attributes:
        good: So many rows from the first are as they were written.
        last: The last of them in words; empty for none.
        forgotten: How many of them have lost their content on purpose.
        code: ``LEDGER_CORRUPT`` or ``LEDGER_CUT_OFF``; empty when nothing is wrong.
        problem: What is wrong, in words.
    """

    good: int = 0
    last: str = ""
    forgotten: int = 0
    code: str = ""
    problem: str = ""


class Chain:
    """Follows the rows of a ledger from the first, as long as each is as it was written.

    Attributes:
        good: How many rows it has followed.
        value: Chain value of the last.
        last: The last in words.
        forgotten: How many of the rows have lost their content.
        unsealed: Layers that have lost it without the row that says so: name → agent, revision
            that is next, and hash of what has stayed.
    """

    def __init__(self) -> None:
        self.good = 0
        self.value = NO_CHAIN
        self.last = ""
        self.forgotten = 0
        self.unsealed: dict[str, tuple[str, int, Any]] = {}

    def follow(self, values: tuple[Any, ...]) -> None:
        """Take the next row, its values in the order of :data:`COLUMNS`.

        Raises:
            Damaged: It is not what was written, or not the next.
        """
        try:
            self._follow(Row(*values))
        except (TypeError, AttributeError, UnicodeError) as error:
            raise Damaged(f"a value of it was changed ({error})") from error

    def _follow(self, row: Row) -> None:
        if row.number != self.good + 1:
            raise Damaged(f"it is not there, the next one has the number {row.number}")
        if chained(self.value, row.digest) != row.chain:
            raise Damaged("the chain of hashes breaks here")
        if row.content is None:
            _, _, seal = self.unsealed.get(row.layer, ("", 0, hashlib.sha256()))
            seal.update(rest_of(row.number, row.agent, row.revision, row.feedback_id))
            self.unsealed[row.layer] = (row.agent, row.revision + 1, seal)
            self.forgotten += 1
        else:
            check_content(row)
            if row.layer.startswith(FORGOTTEN_LAYER):
                self._check_seal(row)
        self.good, self.value = row.number, row.chain
        self.last = f"revision {row.revision} of {name_of(row.agent, row.layer)}"

    def _check_seal(self, row: Row) -> None:
        cause = read_row(row).cause
        _, _, seal = self.unsealed.get(row.layer, ("", 0, hashlib.sha256()))
        if cause.cause != FORGOTTEN or cause.seal != seal.hexdigest():
            raise Damaged("what has stayed of a forgotten layer was changed")
        self.unsealed.pop(row.layer, None)


@contextmanager
def read_only(path: str | Path) -> Iterator[sqlite3.Connection]:
    """Open a database that is neither written nor tidied, so that all that was found stays.

    Raises:
        sqlite3.Error: It cannot be opened.
    """
    address = f"file:{quote(str(path))}?mode=ro"
    database = sqlite3.connect(address, uri=True, timeout=LOCK_WAIT_S, isolation_level=None)
    with closing(database):
        yield database


def newest(path: str | Path) -> Head | str | None:
    """Return the head of a ledger, None when it is missing, or in words how it is damaged.

    Raises:
        OSError: It cannot be read.
    """
    try:
        return read_head(head_path(path))
    except ValueError as error:
        return str(error)


def is_out_of_reach(error: Exception) -> bool:
    """Return True for an error of reading that says nothing about what the file holds."""
    # One without a code is of text that is not UTF-8.
    return isinstance(error, sqlite3.OperationalError) and hasattr(error, "sqlite_errorcode")


def check(database: sqlite3.Connection, head: Head | str | None) -> LedgerReport:
    """Check an open ledger of this format; a writer may have it open as well.

    Args:
        database: The ledger.
        head: What :func:`newest` has returned before, as it is never ahead of the rows.

    Raises:
        sqlite3.OperationalError: It cannot be read at all.
    """
    database.execute("BEGIN")
    try:
        verdict = _rows(database)
        if not verdict.code and (found := structure_problem(database)):
            verdict = replace(verdict, code=CORRUPT, problem=found)
        return verdict if verdict.code else _of_head(database, verdict, head)
    except sqlite3.DatabaseError as error:
        if is_out_of_reach(error):
            raise
        return LedgerReport(code=CORRUPT, problem=str(error))
    finally:
        if database.in_transaction:
            database.execute("ROLLBACK")


def _rows(database: sqlite3.Connection) -> LedgerReport:
    chain, code, problem = Chain(), "", ""
    try:
        for values in database.execute(f"SELECT {COLUMNS} FROM revision ORDER BY number"):
            chain.follow(values)
        if chain.unsealed:
            code, problem = CORRUPT, f"{', '.join(sorted(chain.unsealed))} lost its content"
    except (Damaged, sqlite3.DatabaseError) as error:
        if is_out_of_reach(error):
            raise
        behind = f"{chain.last} (row {chain.good})" if chain.good else "the beginning"
        code, problem = CORRUPT, f"row {chain.good + 1}, behind {behind}: {error}"
    return LedgerReport(
        good=chain.good, last=chain.last, forgotten=chain.forgotten, code=code, problem=problem
    )


def _of_head(
    database: sqlite3.Connection, verdict: LedgerReport, head: Head | str | None
) -> LedgerReport:
    if isinstance(head, str):
        return replace(verdict, code=CORRUPT, problem=f"its -head file is damaged: {head}")
    if head is None:
        return replace(
            verdict,
            code=CUT_OFF,
            problem="its -head file is missing, so nobody can tell whether the newest revisions "
            "are there",
        )
    if head.number > verdict.good:
        return replace(
            verdict,
            code=CUT_OFF,
            problem=f"{head.number} revisions were acknowledged, {verdict.good} are there; the "
            f"last is {verdict.last or 'none'}",
        )
    marked = database.execute("SELECT chain FROM revision WHERE number = ?", (head.number,))
    if head.number and marked.fetchone() != (head.chain,):
        return replace(verdict, code=CORRUPT, problem="its -head file belongs to another ledger")
    return verdict
