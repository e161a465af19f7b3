# SPDX-License-Identifier: Apache-2.0
"""Erases rows from the ledger's file without leaving a trace."""

from __future__ import annotations

import sqlite3

from feedback_node.ledger.file import integer
from feedback_node.ledger.rows import FORGOTTEN_LAYER, Row, hidden, with_checksum

MOST_SKIPPED = 63
"""Most calls of :meth:`FileErasure.retry` that are skipped after a failed rewrite."""

_TASK = "erase"


def erase_layer(database: sqlite3.Connection, agent: str, layer: str) -> str:
    """Erase all content of a layer in a transaction; return the new layer of its rows."""
    found = database.execute(
        "SELECT number, revision, feedback_id FROM revision WHERE agent = ? AND layer = ? "
        "ORDER BY number",
        (agent, layer),
    ).fetchall()
    stays = f"{FORGOTTEN_LAYER}{found[0][0]}"
    for number, revision, feedback_id in found:
        stored_id = None if feedback_id is None else hidden(feedback_id)
        row = with_checksum(Row(number, agent, stays, revision, stored_id, None))
        database.execute(
            "UPDATE revision SET layer = ?, feedback_id = ?, content = NULL, checksum = ? "
            "WHERE number = ?",
            (stays, stored_id, row.checksum, number),
        )
    database.execute("INSERT OR IGNORE INTO pending VALUES (?)", (_TASK,))
    return stays


class FileErasure:
    """Removes the last traces of erased rows from the file as soon as possible.

    It rewrites the file once, which also writes all of it to the log, and empties the log when it
    has no more readers. The file records that this is pending, so it survives a crash.

    Attributes:
        pending: True while traces may be left.
    """

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database
        self._rewritten = False
        self._pause = 0
        self._skip = 0
        found = database.execute("SELECT 1 FROM pending WHERE task = ?", (_TASK,)).fetchone()
        self.pending = found is not None

    def run(self) -> str:
        """Rewrite the file without free pages and empty its log; return why not, "" if done."""
        try:
            if not self._rewritten:
                self._database.execute("VACUUM")
                self._rewritten = True
            if self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]:
                return "somebody else reads the file"
            self._database.execute("DELETE FROM pending WHERE task = ?", (_TASK,))
        except sqlite3.Error as error:
            return str(error)
        self.pending = False
        return ""

    def start(self) -> str:
        """Run after rows were erased; see :meth:`run`."""
        self.pending, self._rewritten = True, False
        self._pause = self._skip = 0
        return self.run()

    def retry(self) -> None:
        """Run again without waiting for readers; retry a failing rewrite less and less often."""
        if not self.pending:
            return
        if self._skip:
            self._skip -= 1
            return
        wait_ms = integer(self._database, "busy_timeout")
        self._database.execute("PRAGMA busy_timeout = 0")
        try:
            self.run()
        finally:
            self._database.execute(f"PRAGMA busy_timeout = {wait_ms}")
        if not self._rewritten:
            self._skip = self._pause = min(2 * self._pause + 1, MOST_SKIPPED)
