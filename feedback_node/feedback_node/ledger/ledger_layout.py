# SPDX-License-Identifier: Apache-2.0
"""The tables of the ledger's SQLite file, and what an SQLite file must say to be one."""

from __future__ import annotations

import sqlite3

FORMAT = 2
OLD_FORMAT = 1
APPLICATION = 0x62746167  # "btag"

_TABLE = """CREATE TABLE revision (
    number INTEGER PRIMARY KEY,
    agent TEXT NOT NULL,
    layer TEXT NOT NULL,
    revision INTEGER NOT NULL,
    feedback_id TEXT,
    content TEXT,
    salt BLOB,
    digest BLOB NOT NULL,
    chain BLOB NOT NULL
)"""
_CHORES = "CREATE TABLE chore (name TEXT PRIMARY KEY)"
_OF_LAYER = "CREATE UNIQUE INDEX revision_of_layer ON revision (agent, layer, revision)"
_OF_FEEDBACK = "CREATE UNIQUE INDEX revision_of_feedback ON revision (feedback_id, layer)"
_NO_DELETE = """CREATE TRIGGER revision_no_delete BEFORE DELETE ON revision
BEGIN SELECT RAISE(ABORT, 'revisions are never deleted; append a new one'); END"""
_NO_UPDATE = """CREATE TRIGGER revision_no_update BEFORE UPDATE ON revision
WHEN NOT (new.content IS NULL AND new.salt IS NULL AND new.number IS old.number
    AND new.agent IS old.agent AND new.revision IS old.revision
    AND new.digest IS old.digest AND new.chain IS old.chain)
BEGIN SELECT RAISE(ABORT, 'revisions are never changed; append a new one'); END"""

_SCHEMA = (_TABLE, _CHORES, _OF_LAYER, _OF_FEEDBACK, _NO_DELETE, _NO_UPDATE)


def lay_out(database: sqlite3.Connection) -> None:
    """Make the tables, inside a transaction of the caller.

    Raises:
        sqlite3.Error: They cannot be made.
    """
    database.execute(f"PRAGMA application_id = {APPLICATION}")
    database.execute(f"PRAGMA user_version = {FORMAT}")
    for statement in _SCHEMA:
        database.execute(statement)


def structure_problem(database: sqlite3.Connection) -> str:
    """Return what is wrong with the tables, indexes and pages, in words; empty for nothing.

    Raises:
        sqlite3.Error: They cannot be read.
    """
    found = database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")
    if sorted(str(sql) for (sql,) in found) != sorted(_SCHEMA):
        return "its tables are not those of a ledger"
    return page_problem(database)


def page_problem(database: sqlite3.Connection) -> str:
    """Return what is wrong with the indexes and pages, in words; empty for nothing.

    Raises:
        sqlite3.Error: They cannot be read.
    """
    problems = [str(row[0]) for row in database.execute("PRAGMA integrity_check(3)")]
    return "" if problems == ["ok"] else "; ".join(problems)


def integer(database: sqlite3.Connection, pragma: str) -> int:
    """Return the number that a pragma of the file has.

    Raises:
        sqlite3.Error: It cannot be read.
    """
    return int(database.execute(f"PRAGMA {pragma}").fetchone()[0])
