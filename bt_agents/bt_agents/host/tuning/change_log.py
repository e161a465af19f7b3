# SPDX-License-Identifier: Apache-2.0
"""SQLite log of tuned values: a change is written before it counts, and on disk soon after."""

from __future__ import annotations

import json
import math
import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, wait
from concurrent.futures import Future as Job
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from threading import Lock
from typing import Any
from urllib.parse import quote

from bt_agents.host.tuning.history import (
    MOST_SHOWN,
    MOST_UNDONE,
    Override,
    TuningAction,
    TuningCause,
    TuningChange,
    TuningHistory,
    TuningRevision,
)
from bt_agents.host.tuning.tunable import Setting
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.private_files import make_private_database, make_private_folder

FORMAT = 1
APPLICATION = 0x6274_4C67
"""``application_id`` of the file."""

MOST_CHANGES = 5000
"""Number of changes after which the file is compacted."""

_MOST_PROBLEMS = 20
_CLOSE_S = 5.0
_LARGEST = 2**63 - 1
_UNDO, _REDO = "undo", "redo"

_SETTINGS = """
PRAGMA page_size = 1024;
PRAGMA journal_mode = WAL;
PRAGMA synchronous = NORMAL;
PRAGMA wal_autocheckpoint = 0;
"""

_TABLES = f"""
BEGIN IMMEDIATE;
CREATE TABLE revisions (
    number INTEGER PRIMARY KEY CHECK (number BETWEEN 1 AND 0xFFFFFFFF),
    stamp REAL NOT NULL CHECK (stamp BETWEEN 0 AND 0x7FFFFFFF),
    author TEXT NOT NULL,
    reason TEXT NOT NULL,
    action TEXT NOT NULL,
    of INTEGER NOT NULL,
    changes TEXT NOT NULL,  -- JSON: [[name, before, after], ...]
    stack TEXT,             -- undo, redo, or NULL for neither
    pushed INTEGER NOT NULL -- number of the revision that put it on its stack
) STRICT;
CREATE INDEX stacks ON revisions (stack, pushed) WHERE stack IS NOT NULL;
CREATE TABLE overrides (
    name TEXT PRIMARY KEY,
    value TEXT NOT NULL,        -- JSON
    file_default TEXT NOT NULL  -- JSON
) STRICT, WITHOUT ROWID;
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {FORMAT};
COMMIT;
"""

_REVISIONS = "SELECT number, stamp, author, reason, action, of, changes FROM revisions"
_ON_STACK = "WHERE stack = ? ORDER BY pushed DESC LIMIT ?"
_CHANGED = "WHERE changes != '[]' ORDER BY number DESC LIMIT ?"

_DAMAGED = (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR)


class _DamagedError(Exception):
    """The file is damaged."""


class ChangeLog:
    """Open log of the changes of one host; no other process can open it meanwhile.

    A written change survives the end of the process at once, and a power cut after :meth:`flush`.
    A change waits while the file is compacted.

    Args:
        path: The file; created with its folder if missing. A damaged file is moved aside.
        disk: Executor with a single thread for the disk.
        report: Logs a line of the host.

    Attributes:
        problems: Problems with the file when it was opened.
        history: All previous changes in the file.

    Raises:
        BtAgentsError: It cannot be opened, or another host has it open.
    """

    def __init__(self, path: Path, disk: Executor, report: Callable[[str], None]) -> None:
        self.problems: list[str] = []
        self._path = path
        self._disk = disk
        self._report = report
        self._lock = Lock()
        self._unflushed = False
        self._flushing: Job[None] = Job()
        self._flushing.set_result(None)
        try:
            make_private_folder(path.parent)
            try:
                self._db, self.history = self._open()
            except _DamagedError as damaged:
                self._set_aside(str(damaged))
                self._db, self.history = self._open()
            # SQLite has no call that waits for the write-ahead log alone.
            self._wal = os.open(f"{path}-wal", os.O_RDONLY)
            [self._count] = self._db.execute("SELECT count(*) FROM revisions").fetchone()
        except (OSError, sqlite3.Error, _DamagedError) as error:
            if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY:
                raise BtAgentsError(
                    f"{path} is in use by another host; give each host a file of its own "
                    "(parameter 'tunings')"
                ) from None
            reason = error.strerror if isinstance(error, OSError) else None
            raise BtAgentsError(f"{path} cannot be opened: {reason or error}") from error

    def append(self, revision: TuningRevision, defaults: Mapping[str, Setting]) -> None:
        """Write a revision, which then survives the process; see :meth:`TuningHistory.add`.

        Raises:
            Refused: ``NOT_KEPT``; it cannot be written, and the file is unchanged.
        """
        with self._writing() as db:
            _push(db, revision)
            for change in revision.changes:
                default = defaults.get(change.name)
                if default == change.after:
                    db.execute("DELETE FROM overrides WHERE name = ?", (change.name,))
                elif default is not None:
                    values = (change.name, _json(change.after), _json(default))
                    db.execute("REPLACE INTO overrides VALUES (?, ?, ?)", values)
        self._unflushed = True
        self._count += 1
        if self._count >= MOST_CHANGES:
            self._count = 0
            self._disk.submit(self._compact)

    def clear(self, name: str) -> None:
        """Remove the override of a value that is now the default in its file.

        It needs no :meth:`flush`: if it is lost, the next start detects it again.

        Raises:
            Refused: ``NOT_KEPT``.
        """
        with self._writing() as db:
            db.execute("DELETE FROM overrides WHERE name = ?", (name,))

    def flush(self) -> Job[None]:
        """Return a job that ends when all previous revisions survive a power cut.

        One job covers all writes before it starts. Its error is an ``OSError``.
        """
        started = self._flushing.running() or self._flushing.done()
        if self._unflushed and started:
            self._flushing = self._disk.submit(os.fdatasync, self._wal)
        self._unflushed = False
        return self._flushing

    def close(self) -> None:
        """Release the file; waits for the disk for a limited time."""
        wait([self._disk.submit(self._close)], _CLOSE_S)

    def _close(self) -> None:
        with self._lock:
            os.close(self._wal)
            self._db.close()

    def _open(self) -> tuple[sqlite3.Connection, TuningHistory]:
        make_private_database(self._path)
        db = sqlite3.connect(self._path, timeout=0, isolation_level=None, check_same_thread=False)
        try:
            db.execute("PRAGMA locking_mode = EXCLUSIVE")
            is_new = self._is_new(db)
            db.executescript(_SETTINGS)
            [verdict] = db.execute("PRAGMA quick_check(1)").fetchone()
            if verdict != "ok":
                raise _DamagedError(verdict.splitlines()[-1])
            if is_new:
                db.executescript(_TABLES)
            return db, self._read(db)
        except sqlite3.DatabaseError as error:
            db.close()
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT)  # none: no UTF-8
            if code & 0xFF in _DAMAGED:
                raise _DamagedError(str(error)) from error
            raise
        except BaseException:
            db.close()
            raise

    def _is_new(self, db: sqlite3.Connection) -> bool:
        [tables] = db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        [application] = db.execute("PRAGMA application_id").fetchone()
        [version] = db.execute("PRAGMA user_version").fetchone()
        if tables and (application, version) != (APPLICATION, FORMAT):
            raise BtAgentsError(
                f"{self._path} is no file of tunings of format {FORMAT}; move it away, or name "
                "another one (parameter 'tunings')"
            )
        return not tables

    def _set_aside(self, reason: str) -> None:
        aside = f"{self._path}.damaged-{time.strftime('%Y%m%d-%H%M%S')}"
        for suffix in ("", "-wal", "-shm"):
            with suppress(FileNotFoundError):
                os.replace(f"{self._path}{suffix}", f"{aside}{suffix}")
        self.problems.append(
            f"{self._path} is damaged: {reason}; it is set aside as {aside}, and everything "
            "stands as the files of the agents say"
        )

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        try:
            with self._lock:
                self._db.execute("BEGIN IMMEDIATE")
                try:
                    yield self._db
                    self._db.execute("COMMIT")
                except BaseException:
                    if self._db.in_transaction:
                        self._db.execute("ROLLBACK")
                    raise
        except sqlite3.Error as error:
            raise Refused(
                "NOT_KEPT",
                f"{self._path} cannot be written: {error}; nothing is changed, because it would "
                "be lost with the host",
            ) from error

    def _compact(self) -> None:
        """Delete what cannot be undone, redone or shown, and empty the write-ahead log."""
        try:
            with self._writing() as db:
                db.execute(
                    "DELETE FROM revisions WHERE stack IS NULL AND number <= "
                    "(SELECT max(number) FROM revisions) - ?",
                    (MOST_UNDONE,),
                )
                db.execute(
                    "DELETE FROM revisions WHERE stack IS NOT NULL AND number NOT IN (SELECT "
                    "number FROM revisions WHERE stack = ? ORDER BY pushed DESC LIMIT ?) AND "
                    "number NOT IN (SELECT number FROM revisions WHERE stack = ? ORDER BY pushed "
                    "DESC LIMIT ?)",
                    (_UNDO, MOST_UNDONE, _REDO, MOST_UNDONE),
                )
            with self._lock:
                self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        except (Refused, sqlite3.Error) as error:
            self._report(f"the file of tunings grows, it cannot be compacted: {error}")

    def _read(self, db: sqlite3.Connection) -> TuningHistory:
        newest = db.execute("SELECT max(number) FROM revisions").fetchone()[0] or 0
        history = TuningHistory(
            newest,
            self._revisions(db, _ON_STACK, _UNDO, MOST_UNDONE),
            self._revisions(db, _ON_STACK, _REDO, MOST_UNDONE),
            self._revisions(db, _CHANGED, MOST_SHOWN),
        )
        for name, value, default in db.execute("SELECT name, value, file_default FROM overrides"):
            try:
                history.overrides[name] = Override(
                    value=_setting(_parsed(value)), default=_setting(_parsed(default))
                )
            except ValueError as error:
                self._problem(f"the value of {name}: {error}")
        return history

    def _revisions(
        self, db: sqlite3.Connection, which: str, *values: object
    ) -> list[TuningRevision]:
        rows = db.execute(f"{_REVISIONS} {which}", values).fetchall()
        found = []
        for row in reversed(rows):
            try:
                found.append(_revision_from(*row))
            except ValueError as error:
                self._problem(f"revision {row[0]}: {error}")
        return found

    def _problem(self, what: str) -> None:
        text = f"{self._path}: {what}; it is left out"
        if text in self.problems:
            return
        if len(self.problems) < _MOST_PROBLEMS:
            self.problems.append(text)
        elif len(self.problems) == _MOST_PROBLEMS:
            self.problems.append(f"{self._path}: and more that cannot be read")


def read_changes(path: Path) -> list[TuningRevision]:
    """Return the last revisions of a log that no host has open, oldest first.

    Raises:
        BtAgentsError: It cannot be read.
    """
    try:
        with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as db:
            rows = db.execute(f"{_REVISIONS} {_CHANGED}", (MOST_SHOWN,)).fetchall()
        return [_revision_from(*row) for row in reversed(rows)]
    except (sqlite3.Error, ValueError) as error:
        if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY:
            hint = "a host has it open; ask its system, with its ROS_DOMAIN_ID"
        else:
            hint = "expected the tunings of a host"
        raise BtAgentsError(f"{path} cannot be read: {error}; {hint}") from error


def _push(db: sqlite3.Connection, revision: TuningRevision) -> None:
    """Insert a revision, and move the one that it undoes or redoes to the other stack."""
    cause, number = revision.cause, revision.number
    if cause.action is TuningAction.SET:
        stack = _UNDO
        db.execute("UPDATE revisions SET stack = NULL WHERE stack = ?", (_REDO,))
    else:
        stack = None
        to = _REDO if cause.action is TuningAction.UNDO else _UNDO
        db.execute(
            "UPDATE revisions SET stack = ?, pushed = ? WHERE number = ?", (to, number, cause.of)
        )
    changes = _json([(one.name, one.before, one.after) for one in revision.changes])
    action = (cause.author, cause.reason, cause.action.value, cause.of)
    row = (number, revision.stamp, *action, changes, stack, number)
    db.execute("INSERT INTO revisions VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", row)


def _json(content: object) -> str:
    return json.dumps(content, ensure_ascii=False, separators=(",", ":"))


def _revision_from(
    number: int, stamp: float, author: str, reason: str, action: str, of: int, changes: str
) -> TuningRevision:
    cause = TuningCause(author=author, reason=reason, action=TuningAction(action), of=of)
    found = _parsed(changes)
    if not isinstance(found, list) or not all(isinstance(o, list) and len(o) == 3 for o in found):
        raise ValueError(f"no list of changes: {changes[:80]!r}")
    return TuningRevision(
        number=number,
        stamp=stamp,
        cause=cause,
        changes=tuple(
            TuningChange(name=str(name), before=_setting(before), after=_setting(after))
            for name, before, after in found
        ),
    )


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"no JSON: {error}") from None


def _setting(found: Any) -> Setting:
    if not isinstance(found, bool | int | float | str):
        raise ValueError(f"{found!r} is no number, text, true or false")
    if isinstance(found, int) and abs(found) > _LARGEST:
        raise ValueError("a whole number has more than 64 bits")
    if isinstance(found, float) and not math.isfinite(found):
        raise ValueError("a number is not finite")
    return found
