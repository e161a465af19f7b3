# SPDX-License-Identifier: Apache-2.0
"""The ledger's SQLite file: one writer, one format, and no silent replacement of a damaged one."""

from __future__ import annotations

import errno
import fcntl
import sqlite3
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from bt_agents_core.errors import STORAGE_FULL, Refused
from feedback_node.ledger.commit_marker import Head, HeadFile, head_path
from feedback_node.ledger.ledger_check import (
    CORRUPT,
    CUT_OFF,
    LOCK_WAIT_S,
    MEND,
    check,
    is_out_of_reach,
    newest,
    read_only,
)
from feedback_node.ledger.ledger_layout import (
    APPLICATION,
    FORMAT,
    OLD_FORMAT,
    integer,
    lay_out,
    page_problem,
)
from feedback_node.ledger.ledger_migration import migrate
from feedback_node.ledger.ledger_rows import Damaged

MEMORY = ":memory:"
"""Path of a ledger that is forgotten when it is closed."""

FAILED = "LEDGER_FAILED"

_FULL = {
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_IOERR_WRITE,
    sqlite3.SQLITE_IOERR_SHMSIZE,
}
_FULL_ERRNO = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


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


def open_database(path: str) -> tuple[sqlite3.Connection, HeadFile | None]:
    """Open a ledger and its head, checked before anything is changed; lay out a new one.

    A ledger of the format before is rewritten in place, in one transaction.

    Raises:
        LedgerError: ``LEDGER_UNREADABLE``, ``LEDGER_CORRUPT``, ``LEDGER_CUT_OFF``,
            ``LEDGER_FOREIGN`` or ``LEDGER_NEWER``, and the file is left as it was found; or as in
            :func:`failed` when a new one cannot be written.
    """
    if path == MEMORY:
        database = sqlite3.connect(MEMORY, isolation_level=None)
        _set_up(database, 0)
        return database, None
    try:
        found = examine(path)
        head = HeadFile(head_path(path))
    except OSError as error:
        if is_full(error):
            raise failed(path, error) from error
        raise LedgerError(
            "LEDGER_UNREADABLE",
            f"{path}: {error}; expected a file of this program that can be read and written",
        ) from error
    try:
        database = sqlite3.connect(path, timeout=LOCK_WAIT_S, isolation_level=None)
        try:
            _set_up(database, found)
        except BaseException:
            database.close()
            raise
    except sqlite3.Error as error:
        head.close()
        raise unreadable(path, error) from error
    except Damaged as error:
        head.close()
        raise damaged(path, CORRUPT, str(error)) from error
    except BaseException:
        head.close()
        raise
    return database, head


def examine(path: str) -> int:
    """Check a file without changing it; return its format, 0 for none yet.

    Raises:
        LedgerError: ``LEDGER_UNREADABLE``, ``LEDGER_CORRUPT``, ``LEDGER_CUT_OFF``,
            ``LEDGER_FOREIGN`` or ``LEDGER_NEWER``.
        OSError: Its head cannot be read.
    """
    head = newest(path)
    if not Path(path).exists() or not Path(path).stat().st_size:
        return _missing(path, head)
    try:
        with read_only(path) as database:
            found = examine_format(database, path)
            if not found:
                return _missing(path, head)
            if found == FORMAT:
                verdict = check(database, head)
                if verdict.code:
                    raise damaged(path, verdict.code, verdict.problem)
            elif found == OLD_FORMAT:
                _refuse_older(path, head)
                if problem := page_problem(database):
                    raise damaged(path, CORRUPT, problem)
            return found
    except (sqlite3.Error, UnicodeDecodeError) as error:
        if isinstance(error, sqlite3.Error) and is_out_of_reach(error):
            raise unreadable(path, error) from error
        raise damaged(path, CORRUPT, str(error)) from error


def _refuse_older(path: str, head: Head | str | None) -> None:
    """Refuse a ledger of the old format beside a head, which only the present format has."""
    if isinstance(head, str):
        raise damaged(path, CORRUPT, head)
    if head is not None and head.number:
        raise damaged(
            path,
            CUT_OFF,
            f"it has the format {OLD_FORMAT}, but {head.number} revisions of format {FORMAT} were "
            "acknowledged",
        )


def _missing(path: str, head: Head | str | None) -> int:
    if isinstance(head, Head) and head.number:
        raise damaged(
            path, CUT_OFF, f"the file is gone or empty, {head.number} revisions were acknowledged"
        )
    return 0


def examine_format(database: sqlite3.Connection, path: str) -> int:
    """Return the format of an open ledger, 0 for an empty file.

    Raises:
        LedgerError: ``LEDGER_CORRUPT``, ``LEDGER_FOREIGN`` or ``LEDGER_NEWER``.
        sqlite3.Error: It cannot be read.
    """
    tables = database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    found = integer(database, "user_version")
    if not tables:
        return 0
    if integer(database, "application_id") != APPLICATION:
        raise LedgerError(
            "LEDGER_FOREIGN",
            f"{path}: an SQLite file of another program; give 'ledger' another path",
        )
    if found > FORMAT:
        raise LedgerError(
            "LEDGER_NEWER",
            f"{path}: format {found}, this program knows {FORMAT}; update it, or move the file "
            "away, with its -wal, -shm and -head, to start with the profiles of the agents' files",
        )
    if found < OLD_FORMAT:
        raise damaged(path, CORRUPT, f"it says that it has the format {found}, which never was")
    return found


def _set_up(database: sqlite3.Connection, found: int) -> None:
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    database.execute("PRAGMA secure_delete = ON")
    database.execute("BEGIN IMMEDIATE")
    if found == FORMAT:
        # One that can only be read says so now rather than with the first feedback.
        database.execute(f"PRAGMA user_version = {FORMAT}")
        database.execute("ROLLBACK")
        return
    try:
        if found == OLD_FORMAT:
            migrate(database)
        else:
            lay_out(database)
        database.execute("COMMIT")
    except BaseException:
        with suppress(sqlite3.Error):
            database.execute("ROLLBACK")
        raise
    # Without its log the file would be one of the old format again.
    database.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def unreadable(path: str, error: sqlite3.Error) -> LedgerError:
    """Return the error for a file that the operating system does not let us use."""
    if is_full(error):
        return failed(path, error)
    return LedgerError(
        "LEDGER_UNREADABLE",
        f"{path}: {error}; expected an SQLite file of this program that can be read and written",
    )


def damaged(path: str, code: str, found: str) -> LedgerError:
    """Return the error for a file with damaged content."""
    return LedgerError(code, f"{path}: {found}. {MEND}")


def is_full(error: Exception) -> bool:
    """Return True for an error of writing that comes from a disk, or a quota, that is full."""
    if isinstance(error, OSError):
        return error.errno in _FULL_ERRNO
    return getattr(error, "sqlite_errorcode", None) in _FULL


def failed(path: str, error: Exception) -> LedgerError:
    """Return the error for something that was not recorded."""
    if is_full(error):
        return LedgerError(
            STORAGE_FULL,
            f"{path}: {error}: the disk takes no more, nothing was recorded; make room, what is "
            "given after that is recorded again",
        )
    return LedgerError(
        FAILED,
        f"{path}: {error}; nothing was recorded, look at the disk's space and rights",
    )
