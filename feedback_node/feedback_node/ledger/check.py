# SPDX-License-Identifier: Apache-2.0
"""Checks a ledger: checksums of all rows, gaps in the revisions, and SQLite's own check."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from typing import Any

from feedback_node.ledger.rows import COLUMNS, Row, has_tables, name_of

_MOST_PAGES = 3
"""Most problems that SQLite is asked for."""


class LedgerCheck:
    """Result so far of one pass over all rows of a ledger.

    Attributes:
        good: Number of intact rows whose profile has all earlier revisions.
        forgotten: Number of good rows whose content was erased on purpose.
        problems: Problems with the affected rows or pages; empty for none.
        last: Number of the last row.
        recorded: Number of the last recorded row; 0 if unknown.
    """

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database
        self._next: dict[tuple[str, str], int] = {}
        self._broken: set[tuple[str, str]] = set()
        self.good = self.forgotten = self.last = self.recorded = 0
        self.problems: list[str] = []

    @property
    def lost(self) -> str:
        """The rows missing at the end, in words; empty for none."""
        if self.last >= self.recorded:
            return ""
        return f"rows {self.last + 1} to {self.recorded}, the last ones, are missing"

    def good_rows(self) -> Iterator[Row]:
        """Yield the good rows in order of entry.

        Raises:
            sqlite3.OperationalError: The file cannot be accessed.
        """
        for row in self._rows():
            self.last = row.number
            profile = (row.agent, row.layer)
            if problem := self._problem(row):
                self.problems.append(problem)
                self._broken.add(profile)
            if profile not in self._broken:
                self.good += 1
                self.forgotten += row.content is None
                yield row

    def _problem(self, row: Row) -> str:
        profile = (row.agent, row.layer)
        expected = self._next.get(profile, 0)
        if not row.is_intact:
            # A damaged row still fills its place, so that its successor is not reported, too.
            self._next[profile] = expected + (row.revision == expected)
            return f"row {row.number} ({row.name}) is damaged"
        self._next[profile] = row.revision + 1
        if row.revision != expected:
            return f"revision {expected} of {name_of(*profile)} is missing before row {row.number}"
        return ""

    def _rows(self) -> Iterator[Row]:
        """Yield all readable rows: up to a damaged page, and from the end back to it."""
        last = 0
        try:
            for row in self._select("ORDER BY number"):
                if not _is_between(last, row.number, None):
                    raise sqlite3.DatabaseError(f"row {row.number} comes after row {last}")
                last = row.number
                yield row
            return
        except sqlite3.DatabaseError as error:
            if is_out_of_reach(error):
                raise
            reason = str(error)
        behind: list[Row] = []
        try:
            for row in self._select("ORDER BY number DESC"):
                if not _is_between(last, row.number, behind[-1].number if behind else None):
                    break
                behind.append(row)
        except sqlite3.DatabaseError as error:
            if is_out_of_reach(error):
                raise
        lost = f"{last + 1} to {behind[-1].number - 1}" if behind else f"from {last + 1} on"
        self.problems.append(f"rows {lost} cannot be read ({reason})")
        yield from reversed(behind)

    def _select(self, order: str) -> Iterator[Row]:
        return map(Row._make, self._database.execute(f"SELECT {COLUMNS} FROM revision {order}"))


def check(database: sqlite3.Connection) -> LedgerCheck:
    """Check an open ledger of this format; a writer may also have it open.

    Raises:
        sqlite3.OperationalError: The file cannot be accessed.
    """
    found = LedgerCheck(database)
    database.execute("BEGIN")
    try:
        for _ in found.good_rows():
            pass
        if not has_tables(database):
            found.problems.append("its tables are not the tables of a ledger")
        pages = [str(row[0]) for row in database.execute(f"PRAGMA integrity_check({_MOST_PAGES})")]
        if pages != ["ok"]:
            text = "; ".join(pages).replace("\n", "; ")
            found.problems.append(f"its pages and indexes: {text}")
    except sqlite3.DatabaseError as error:
        if is_out_of_reach(error):
            raise
        found.problems.append(f"its pages and indexes: {error}")
    finally:
        if database.in_transaction:
            database.execute("ROLLBACK")
    return found


def is_out_of_reach(error: Exception) -> bool:
    """Return True for a read error that does not mean damage."""
    if not isinstance(error, sqlite3.OperationalError):
        return False
    # A missing table or an invalid header is an operational error, too.
    return error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_ERROR


def _is_between(low: int, number: Any, high: int | None) -> bool:
    """Return whether the number of a row is possible here; damage may change it arbitrarily."""
    return isinstance(number, int) and low < number and (high is None or number < high)
