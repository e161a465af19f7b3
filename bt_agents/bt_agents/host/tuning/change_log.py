# SPDX-License-Identifier: Apache-2.0
"""File of the tuning history: a change is written before it counts, and on disk soon after."""

from __future__ import annotations

import errno
import fcntl
import json
import math
import os
import time
from concurrent.futures import Executor, wait
from concurrent.futures import Future as Job
from pathlib import Path
from threading import Lock
from typing import Any

from bt_agents.host.tuning.history import (
    Override,
    TuningAction,
    TuningCause,
    TuningChange,
    TuningHistory,
    TuningRevision,
)
from bt_agents.host.tuning.tunable import Setting
from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.private_files import make_private_file, make_private_folder, open_private
from bt_agents_core.refusal_codes import RefusalCode

FORMAT = 1

MOST_BYTES = 64 * 1024 * 1024
"""Largest file that is read."""

_CLOSE_S = 5.0
_LARGEST = 2**63 - 1


class ChangeLog:
    """File with the tuning history of one host; no other host can open it meanwhile.

    A history is first written next to the file, where it survives the end of the process at once,
    and takes the place of the file as soon as it survives a power cut; see :meth:`flush`.

    Args:
        path: The file; created with its folder if missing. A damaged file is moved aside.
        disk: Executor with a single thread for the disk.

    Attributes:
        history: The history at the start.
        problem: What was wrong with the file; empty for nothing.

    Raises:
        BtAgentsError: It cannot be opened, has another format, or another host has it open.
    """

    def __init__(self, path: Path, disk: Executor) -> None:
        self.problem = ""
        self._path = path
        self._new = _beside(path)
        self._disk = disk
        self._lock = Lock()
        self._unflushed = False
        self._flushing: Job[None] = Job()
        self._flushing.set_result(None)
        try:
            make_private_folder(path.parent)
            self._held = open_private(path.with_name(f"{path.name}.lock"), os.O_RDWR)
            try:
                fcntl.flock(self._held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                self.history = self._read()
            except BaseException:
                os.close(self._held)
                raise
        except BlockingIOError:
            raise BtAgentsError(
                f"{path} is in use by another host; give each host a file of its own (parameter "
                "'tunings')"
            ) from None
        except OSError as error:
            raise BtAgentsError(f"{path} cannot be opened: {error.strerror}") from error

    def _read(self) -> TuningHistory:
        try:
            return read_history(self._path)
        except ValueError as damage:
            aside = f"{self._path}.damaged-{time.strftime('%Y%m%d-%H%M%S')}"
            os.replace(self._path, aside)
            self.problem = (
                f"{self._path} is damaged: {damage}; it is set aside as {aside}, and everything "
                "stands as the files of the agents say"
            )
            return TuningHistory()

    def write(self, history: TuningHistory) -> None:
        """Write a history, which then survives the process.

        Raises:
            Refused: ``STORAGE_FULL`` or ``CANNOT_WRITE``; earlier entries are still there.
        """
        text = _text(history)
        try:
            with self._lock:
                make_private_file(self._new)
                write_atomically(self._new, text, durable=False)
        except OSError as error:
            raise not_kept(self._path, error) from error
        self._unflushed = True

    def flush(self) -> Job[None]:
        """Return a job that ends when all that was written before survives a power cut.

        One job covers all writes before it starts. Its error is an ``OSError``.
        """
        started = self._flushing.running() or self._flushing.done()
        if self._unflushed and started:
            self._flushing = self._disk.submit(self._flush)
        self._unflushed = False
        return self._flushing

    def _flush(self) -> None:
        try:
            written = os.open(self._new, os.O_RDONLY | os.O_CLOEXEC)
        except FileNotFoundError:
            return  # An earlier job has flushed the last history, too.
        try:
            os.fsync(written)
            with self._lock:
                # A history that was written meanwhile has a job of its own.
                if os.path.samestat(os.fstat(written), os.stat(self._new)):
                    os.replace(self._new, self._path)
        finally:
            os.close(written)
        folder = os.open(self._path.parent, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def close(self) -> None:
        """Release the file; waits for the disk for a limited time."""
        self.flush()
        wait([self._disk.submit(os.close, self._held)], _CLOSE_S)


def read_history(path: Path) -> TuningHistory:
    """Return the history in a file, which a host may have open; an empty one without a file.

    Raises:
        ValueError: The file is damaged.
        OSError: It cannot be read.
        BtAgentsError: It has another format.
    """
    try:
        return _history(_beside(path))
    except (FileNotFoundError, ValueError):
        pass  # A power cut may have torn the last, unflushed entries.
    try:
        return _history(path)
    except FileNotFoundError:
        return TuningHistory()


def not_kept(path: Path, error: OSError) -> Refused:
    """Return the refusal of a change that cannot be written."""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    return Refused(
        RefusalCode.STORAGE_FULL if full else RefusalCode.CANNOT_WRITE,
        f"{path} cannot be written: {error.strerror or error}; nothing is changed",
    )


def _beside(path: Path) -> Path:
    return path.with_name(f"{path.name}.new")


def _text(history: TuningHistory) -> str:
    every = {
        one.number: one for one in (*history.undoable, *history.redoable, *history.shown)
    }  # fmt: skip
    content = {
        "format": FORMAT,
        "revisions": [_plain(one) for one in every.values()],
        "undoable": [one.number for one in history.undoable],
        "redoable": [one.number for one in history.redoable],
        "shown": [one.number for one in history.shown],
        "overrides": {n: [one.value, one.default] for n, one in history.overrides.items()},
    }
    return json.dumps(content, separators=(",", ":"))


def _plain(revision: TuningRevision) -> list[object]:
    cause = revision.cause
    changes = [[one.name, one.before, one.after] for one in revision.changes]
    action = (cause.author, cause.reason, cause.action.value, cause.of)
    return [revision.number, revision.stamp, *action, changes]


def _history(path: Path) -> TuningHistory:
    with path.open("rb") as opened:
        data = opened.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"it has more than {MOST_BYTES} bytes")
    try:
        found = json.loads(data)
        version = found["format"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise ValueError(f"it is not JSON with a format: {error}") from None
    if version != FORMAT:
        raise BtAgentsError(
            f"{path} is not a file of tunings of format {FORMAT}; move it away, or name another "
            "(parameter 'tunings')"
        )
    try:
        every = {one.number: one for one in map(_revision, found["revisions"])}

        def listed(key: str) -> tuple[TuningRevision, ...]:
            return tuple(every[number] for number in found[key])

        return TuningHistory(
            undoable=listed("undoable"),
            redoable=listed("redoable"),
            shown=listed("shown"),
            overrides={
                str(name): Override(value=_setting(value), default=_setting(default))
                for name, (value, default) in found["overrides"].items()
            },
        )
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None


def _revision(found: Any) -> TuningRevision:
    number, stamp, author, reason, action, of, changes = found
    return TuningRevision(
        number=int(number),
        stamp=float(_setting(stamp)),
        cause=TuningCause(
            author=str(author), reason=str(reason), action=TuningAction(action), of=int(of)
        ),
        changes=tuple(
            TuningChange(name=str(name), before=_setting(before), after=_setting(after))
            for name, before, after in changes
        ),
    )


def _setting(found: Any) -> Setting:
    if not isinstance(found, bool | int | float | str):
        raise ValueError(f"{str(found)[:40]!r} is not a number, text, true or false")
    if isinstance(found, int) and abs(found) > _LARGEST:
        raise ValueError("a whole number has more than 64 bits")
    if isinstance(found, float) and not math.isfinite(found):
        raise ValueError("a number is not finite")
    return found
