# SPDX-License-Identifier: Apache-2.0
"""Takes the content of rows out of the ledger's file, so that not even a trace stays in it."""

from __future__ import annotations

import hashlib
import sqlite3

from feedback_node.ledger_rows import hidden, rest_of

SCRUB = "scrub"
"""Chore of a ledger that has forgotten something whose traces are still in its file."""


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


def scrub(database: sqlite3.Connection) -> str:
    """Rewrite the file without free pages, and empty its write-ahead log.

    Returns:
        Why that could not be done yet, in words; empty when it is done.
    """
    try:
        database.execute("VACUUM")
        if database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]:
            return "somebody else reads the file"
        database.execute("DELETE FROM chore WHERE name = ?", (SCRUB,))
    except sqlite3.Error as error:
        return str(error)
    return ""
