# SPDX-License-Identifier: Apache-2.0
"""The ledger's SQLite file: one writer, one format, and no silent replacement of a damaged one."""

from __future__ import annotations

import fcntl
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import TextIO

from bt_agents.errors import Refused

MEMORY = ":memory:"
"""Path of a ledger that is forgotten when it is closed."""

_FORMAT = 1
_LOCK_WAIT_S = 0.5
_APPLICATION = 0x62746167  # "btag"
_TABLE = """
CREATE TABLE revision (
    agent TEXT NOT NULL,
    revision INTEGER NOT NULL,
    profile TEXT NOT NULL,
    cause TEXT NOT NULL,
    kind INTEGER NOT NULL,
    source TEXT NOT NULL,
    reason TEXT NOT NULL,
    feedback_id TEXT UNIQUE,
    epoch TEXT NOT NULL,
    round INTEGER NOT NULL,
    rate REAL NOT NULL,
    target TEXT NOT NULL,
    scene_id TEXT NOT NULL,
    cancels INTEGER NOT NULL,
    restores INTEGER,
    stamp REAL NOT NULL,
    PRIMARY KEY (agent, revision)
) WITHOUT ROWID
"""
_APPEND_ONLY = """
CREATE TRIGGER revision_no_{verb} BEFORE {verb} ON revision
BEGIN SELECT RAISE(ABORT, 'revisions are never changed; append a new one'); END
"""


class LedgerError(Refused):
    """The ledger cannot be read or written; its code says why."""


def ledger_path(explicit: str, environment: Mapping[str, str]) -> str:
    """Return where the ledger lies: ``explicit``, else the user's state folder."""
    if explicit == MEMORY:
        return explicit
    if explicit:
        return str(Path(explicit).expanduser())
    state = environment.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return str(Path(state) / "bt-agents" / "ledger.sqlite")


def lock_file(path: Path) -> TextIO:
    """Keep other writers out until the returned file is closed; create the folder.

    Raises:
        LedgerError: ``LEDGER_UNREADABLE`` or ``LEDGER_IN_USE``.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_name(path.name + ".lock").open("w")
    except OSError as error:
        raise LedgerError(
            "LEDGER_UNREADABLE",
            f"{path}: {error.strerror}; give the parameter 'ledger' a path that can be written",
        ) from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        raise LedgerError(
            "LEDGER_IN_USE",
            f"{path}: another feedback node writes it; end that one or give this one another path",
        ) from None
    return lock


def open_database(path: str) -> sqlite3.Connection:
    """Open a database, check it before anything in it is changed, and lay out a new one.

    Raises:
        LedgerError: ``LEDGER_UNREADABLE``, ``LEDGER_CORRUPT``, ``LEDGER_FOREIGN`` or
            ``LEDGER_NEWER``; the file is left as it was found.
    """
    try:
        database = sqlite3.connect(path, timeout=_LOCK_WAIT_S, isolation_level=None)
    except sqlite3.Error as error:
        raise unreadable(path, error) from error
    try:
        _check(database, path)
    except sqlite3.OperationalError as error:
        database.close()
        raise unreadable(path, error) from error
    except sqlite3.DatabaseError as error:
        database.close()
        raise corrupt(path, str(error)) from error
    except BaseException:
        database.close()
        raise
    return database


def _check(database: sqlite3.Connection, path: str) -> None:
    problems = [str(row[0]) for row in database.execute("PRAGMA quick_check(3)")]
    if problems != ["ok"]:
        raise corrupt(path, "; ".join(problems))
    tables = database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    application = database.execute("PRAGMA application_id").fetchone()[0]
    found = database.execute("PRAGMA user_version").fetchone()[0]
    if tables and application != _APPLICATION:
        raise LedgerError(
            "LEDGER_FOREIGN",
            f"{path}: an SQLite file of another program; give 'ledger' another path",
        )
    if found > _FORMAT:
        raise LedgerError(
            "LEDGER_NEWER",
            f"{path}: format {found}, this program knows {_FORMAT}; update it, or move the file "
            f"away to start with the profiles of the agents' files",
        )
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    if not tables:
        database.execute("BEGIN IMMEDIATE")
        database.execute(f"PRAGMA application_id = {_APPLICATION}")
        database.execute(f"PRAGMA user_version = {_FORMAT}")
        database.execute(_TABLE)
        for verb in ("UPDATE", "DELETE"):
            database.execute(_APPEND_ONLY.format(verb=verb))
        database.execute("COMMIT")


def unreadable(path: str, error: sqlite3.Error) -> LedgerError:
    """Return the error for a file that the operating system does not let us use."""
    return LedgerError(
        "LEDGER_UNREADABLE",
        f"{path}: {error}; expected an SQLite file of this program that can be read and written",
    )


def corrupt(path: str, found: str) -> LedgerError:
    """Return the error for a file with damaged content."""
    return LedgerError(
        "LEDGER_CORRUPT",
        f"{path}: {found}; nothing was changed. Move the file away (with its -wal and -shm) to "
        f"start with the profiles of the agents' files, or put a copy back",
    )
