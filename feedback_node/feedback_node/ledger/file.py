# SPDX-License-Identifier: Apache-2.0
"""The ledger's SQLite file: one writer, one format, and no silent replacement if damaged."""

from __future__ import annotations

import errno
import fcntl
import os
import sqlite3
from collections.abc import Sequence
from contextlib import closing, suppress
from operator import methodcaller
from pathlib import Path
from urllib.parse import quote

from bt_agents_core.errors import Refused
from bt_agents_core.private_files import make_private_database, make_private_folder, open_private
from bt_agents_core.refusal_codes import RefusalCode
from feedback_node.ledger.check import LedgerCheck, check, is_out_of_reach
from feedback_node.ledger.rows import APPLICATION, FORMAT, INSERT, create_tables

MEMORY = ":memory:"
"""Path of a ledger in memory, which is lost when it is closed."""

_LOCK_WAIT_S = 0.5
_MOST_PROBLEMS = 3
_REPAIR = (
    "Nothing was changed. 'bt-agents profile recover' copies the good revisions into a new file; "
    "or put a copy back; or move the file away, with its -wal, -shm and .lock, to start with the "
    "profiles of the agents' files"
)
_MARK_BYTES = 40
_FULL = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE, sqlite3.SQLITE_IOERR_SHMSIZE}
_WRITTEN_TWICE = {sqlite3.SQLITE_CONSTRAINT_UNIQUE, sqlite3.SQLITE_CONSTRAINT_PRIMARYKEY}
_FULL_ERRNO = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class LedgerError(Refused):
    """The ledger cannot be read or written; its code says why."""


class LedgerLock:
    """Lock file of a ledger, which excludes other writers and holds the number of the last row.

    SQLite silently drops the end of a damaged log; the number reveals the loss.
    """

    def __init__(self, path: Path) -> None:
        """Lock a ledger; create its folder if missing.

        Raises:
            LedgerError: ``LEDGER_UNREADABLE`` or ``LEDGER_IN_USE``.
        """
        self._recorded = -1
        try:
            make_private_folder(path.parent)
            self._file = open_private(_lock_of(path), os.O_WRONLY)
        except OSError as error:
            raise LedgerError(
                RefusalCode.LEDGER_UNREADABLE,
                f"{path}: {error.strerror}; give the parameter 'ledger' a path that can be "
                "written",
            ) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise LedgerError(
                RefusalCode.LEDGER_IN_USE,
                f"{path}: another feedback node writes it; end that one or give this one another "
                "path",
            ) from None

    def record(self, number: int) -> None:
        """Record the number of the last row, which is already on disk."""
        if number == self._recorded:
            return
        # The row counts even without it; only its loss would then go unnoticed.
        with suppress(OSError):
            # Written twice, so that damage to the number itself is detected.
            os.pwrite(self._file, f"{number:019d}\n".encode() * 2, 0)
            os.fdatasync(self._file)
            self._recorded = number

    def close(self) -> None:
        """Release the lock for another writer."""
        os.close(self._file)


def _recorded_in(lock: Path) -> int:
    """Return the number of the last row from a lock file; 0 if it does not contain one."""
    try:
        with lock.open("rb") as opened:
            one, other = opened.read(_MARK_BYTES).split()
        return int(one) if one == other else 0
    except (OSError, ValueError):
        return 0


def _lock_of(path: Path) -> Path:
    return path.with_name(path.name + ".lock")


def connect(path: str, mode: str) -> sqlite3.Connection:
    """Open a database; ``ro``, ``rwc`` or ``memory`` as in SQLite's URI."""
    address = f"file:{quote(path)}?mode={mode}"
    database = sqlite3.connect(address, uri=True, timeout=_LOCK_WAIT_S, isolation_level=None)
    # The checksum of its row detects damaged text.
    database.text_factory = methodcaller("decode", errors="surrogateescape")
    return database


def open_database(path: str) -> sqlite3.Connection:
    """Open a ledger for writing, checked before any change; create a missing one.

    Raises:
        LedgerError: As in :func:`inspect`, ``LEDGER_CORRUPT`` or ``LEDGER_CUT_OFF``; the file is
            unchanged. Or as in :func:`failed` if a new one cannot be written.
    """
    if path != MEMORY and has_content(path):
        found = inspect(path)
        if found.problems:
            raise damaged(path, found.problems)
        if found.lost:
            raise LedgerError(
                RefusalCode.LEDGER_CUT_OFF,
                f"{path}: {found.lost}. Nothing was changed. {repair_of_cut_off(path)}",
            )
    try:
        if path != MEMORY:
            make_private_database(Path(path))
        database = connect(path, "memory" if path == MEMORY else "rwc")
        try:
            _set_up(database)
        except BaseException:
            database.close()
            raise
    except (OSError, sqlite3.Error) as error:
        raise unreadable(path, error) from error
    return database


def inspect(path: str) -> LedgerCheck:
    """Check a ledger, even one that a feedback node has open, without changing it.

    Raises:
        LedgerError: It is not a ledger of this format: ``LEDGER_UNREADABLE``, ``LEDGER_FOREIGN``,
            ``OTHER_FORMAT``, or ``LEDGER_CORRUPT`` if it is not a database.
    """
    # Read first, because a writer may continue. The lock is next to the file, not next to a link.
    recorded = _recorded_in(_lock_of(Path(path).resolve()))
    try:
        with closing(_examined(path)) as database:
            found = check(database) if _is_ledger(database, path) else LedgerCheck(database)
            found.recorded = recorded
            return found
    except (sqlite3.Error, UnicodeDecodeError) as error:
        # The error message may quote damaged text.
        raise unread(path, error) from error


def recover(path: str, new: str) -> int:
    """Copy the good rows of a damaged ledger to a new one; return their number.

    Raises:
        Refused: ``FILE_EXISTS``; the new file already exists.
        LedgerError: As in :func:`inspect`, or the new file cannot be written.
    """
    if Path(new).exists():
        raise Refused(RefusalCode.FILE_EXISTS, f"{new}: it is there already; choose another name")
    inspect(path)
    with closing(open_database(new)) as copy:
        try:
            with closing(_examined(path)) as old:
                rows = LedgerCheck(old)
                copy.execute("BEGIN IMMEDIATE")
                copy.executemany(INSERT, rows.good_rows())
                copy.execute("COMMIT")
        except sqlite3.Error as error:
            raise unreadable(new, error) from error
    return rows.good


def _examined(path: str) -> sqlite3.Connection:
    """Open a ledger to read what is left of it, even if its end is cut off."""
    database = connect(path, "ro")
    # Else SQLite refuses a file that is shorter than its header says.
    database.execute("PRAGMA writable_schema = ON")
    return database


def has_content(path: str) -> bool:
    """Return whether a ledger has been created.

    Raises:
        LedgerError: ``LEDGER_CORRUPT`` if only its log exists, or ``LEDGER_UNREADABLE``.
    """
    file, log, journal = Path(path), Path(path + "-wal"), Path(path + "-journal")
    try:
        if journal.exists():
            # The creation of the ledger was interrupted; SQLite rolls it back before reading.
            with closing(connect(path, "rwc")) as database:
                integer(database, "schema_version")
        if file.exists() and file.stat().st_size:
            return True
        if log.exists() and log.stat().st_size:
            # Opening the file would make SQLite delete the log.
            raise damaged(path, ["the file is gone or empty, and its log (-wal) is there"])
    except (OSError, sqlite3.Error) as error:
        raise unreadable(path, error) from error
    return False


def _is_ledger(database: sqlite3.Connection, path: str) -> bool:
    """Return whether an open file is a ledger of this format; False for one without tables."""
    if not database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        return False
    if integer(database, "application_id") != APPLICATION:
        raise LedgerError(
            RefusalCode.LEDGER_FOREIGN,
            f"{path}: an SQLite file of another program; give 'ledger' another path",
        )
    if (found := integer(database, "user_version")) != FORMAT:
        raise LedgerError(
            RefusalCode.OTHER_FORMAT,
            f"{path}: format {found}, this program knows {FORMAT} only; use the version that has "
            "written it, or move the file away, with its -wal, -shm and .lock, to start with the "
            "profiles of the agents' files",
        )
    return True


def _set_up(database: sqlite3.Connection) -> None:
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    database.execute("PRAGMA secure_delete = ON")
    database.execute("BEGIN IMMEDIATE")
    try:
        if integer(database, "user_version"):
            # A read-only file fails here rather than at the first feedback.
            database.execute(f"PRAGMA user_version = {FORMAT}")
            database.execute("ROLLBACK")
        else:
            create_tables(database)
            database.execute("COMMIT")
    except BaseException:
        with suppress(sqlite3.Error):
            database.execute("ROLLBACK")
        raise


def integer(database: sqlite3.Connection, pragma: str) -> int:
    """Return the integer value of a pragma."""
    return int(database.execute(f"PRAGMA {pragma}").fetchone()[0])


def unreadable(path: str, error: Exception) -> LedgerError:
    """Return the error for a file that the operating system does not let us access."""
    if is_full(error):
        return failed(path, error)
    return LedgerError(
        RefusalCode.LEDGER_UNREADABLE,
        f"{path}: {error}; expected an SQLite file of this program that can be read and written",
    )


def repair_of_cut_off(path: str) -> str:
    """Return in words how to repair a ledger that has lost its end."""
    return (
        "The end of its log (-wal) is damaged or gone, or an older copy is in its place: put the "
        f"newer files back, if there are any; to go on with this one, remove {path}.lock"
    )


def damaged(path: str, problems: Sequence[str]) -> LedgerError:
    """Return the error for a file with damaged content."""
    more = len(problems) - _MOST_PROBLEMS
    found = "; ".join(problems[:_MOST_PROBLEMS]) + (f"; and {more} more" if more > 0 else "")
    return LedgerError(RefusalCode.LEDGER_CORRUPT, f"{path}: {found}. {_REPAIR}")


def unread(path: str, error: Exception) -> LedgerError:
    """Return the error for a failed read."""
    return unreadable(path, error) if is_out_of_reach(error) else damaged(path, [str(error)])


def is_full(error: Exception) -> bool:
    """Return whether a write error comes from a full disk or quota."""
    if isinstance(error, OSError):
        return error.errno in _FULL_ERRNO
    return getattr(error, "sqlite_errorcode", None) in _FULL


def _is_of_another_writer(error: Exception) -> bool:
    """Return whether an error can only come from a second process that writes the file.

    Either a revision exists that this process has not written, or the other one is writing now.
    """
    code = getattr(error, "sqlite_errorcode", 0)
    return code in _WRITTEN_TWICE or code & 0xFF == sqlite3.SQLITE_BUSY


def failed(path: str, error: Exception) -> LedgerError:
    """Return the error for a change that was not recorded."""
    if is_full(error):
        return LedgerError(
            RefusalCode.STORAGE_FULL,
            f"{path}: {error}: the disk takes no more, nothing was recorded; make room, what is "
            "given after that is recorded again",
        )
    if _is_of_another_writer(error):
        return LedgerError(
            RefusalCode.LEDGER_IN_USE,
            f"{path}: somebody else writes it, too ({error}), probably a second feedback node, as "
            f"its lock {path}.lock was removed; nothing was recorded. End both, and start one",
        )
    return LedgerError(
        RefusalCode.LEDGER_FAILED,
        f"{path}: {error}; nothing was recorded, look at the disk's space and rights",
    )
