# SPDX-License-Identifier: Apache-2.0
"""Takes the content of rows out of the ledger's file, so that not even a trace stays in it."""

from __future__ import annotations

import hashlib
import sqlite3

from feedback_node.ledger.ledger_layout import integer
from feedback_node.ledger.ledger_rows import hidden, rest_of

SCRUB = "scrub"
"""Chore of a ledger that has forgotten something whose traces are still in its file."""

MOST_SKIPPED = 63
"""So many times at most :meth:`Scrubber.again` does nothing after a rewriting that failed."""


def redact(database: sqlite3.Connection, agent: str, layer: str, stays: str) -> str:
    """Take out the content of all rows of a layer, inside a transaction of the caller.

    Args:
        database: The ledger.
        agent: Whose.
        layer: Which; its name goes, too.
        stays: Name under which the rows stay.

    Returns:
        Hash of what has stayed of them, for the row that says so.

    Raises:
        sqlite3.Error: The file cannot be written.
    """
    seal = hashlib.sha256()
    found = database.execute(
        "SELECT number, revision, feedback_id FROM revision WHERE agent = ? AND layer = ? "
        "ORDER BY number",
        (agent, layer),
    ).fetchall()
    for number, revision, feedback_id in found:
        kept = None if feedback_id is None else hidden(feedback_id)
        seal.update(rest_of(number, agent, revision, kept))
        database.execute(
            "UPDATE revision SET layer = ?, feedback_id = ?, content = NULL, salt = NULL "
            "WHERE number = ?",
            (stays, kept, number),
        )
    database.execute("INSERT OR IGNORE INTO chore VALUES (?)", (SCRUB,))
    return seal.hexdigest()


class Scrubber:
    """Takes the last traces of what was forgotten out of the file, as soon as that can be done.

    The file is rewritten once; the log, which has grown by all of it, is emptied when nobody
    reads it any more.

    Args:
        database: The ledger.
    """

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database
        self._rewritten = True
        self._pause = 0
        self._skip = 0
        found = database.execute("SELECT 1 FROM chore WHERE name = ?", (SCRUB,)).fetchone()
        self.outstanding = found is not None
        if self.outstanding:
            self.due()

    def due(self) -> None:
        """Note that something was forgotten."""
        self.outstanding, self._rewritten = True, False
        self._pause = self._skip = 0

    def scrub(self) -> str:
        """Rewrite the file without free pages, and empty its write-ahead log.

        Returns:
            Why that could not be done yet, in words; empty when it is done.
        """
        try:
            if not self._rewritten:
                self._database.execute("VACUUM")
                self._rewritten = True
            if self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]:
                return "somebody else reads the file"
            self._database.execute("DELETE FROM chore WHERE name = ?", (SCRUB,))
        except sqlite3.Error as error:
            return str(error)
        self.outstanding = False
        return ""

    def again(self) -> None:
        """Try once more without waiting for anybody; a rewriting that fails ever more seldom."""
        if not self.outstanding:
            return
        if self._skip:
            self._skip -= 1
            return
        waits = integer(self._database, "busy_timeout")
        self._database.execute("PRAGMA busy_timeout = 0")
        try:
            self.scrub()
        finally:
            self._database.execute(f"PRAGMA busy_timeout = {waits}")
        if not self._rewritten:
            self._skip = self._pause = min(2 * self._pause + 1, MOST_SKIPPED)
