# SPDX-License-Identifier: Apache-2.0
"""The file in which tuning outlives the host: one line a change, written before it counts."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, wait
from concurrent.futures import Future as Job
from contextlib import suppress
from pathlib import Path

from bt_agents.host.tuning.change_log_lines import (
    agreed_line,
    revision_line,
    state_line,
    take_line,
)
from bt_agents.host.tuning.history import TuningRevision
from bt_agents.host.tuning.overrides import Overrides
from bt_agents.host.tuning.tunable import Setting
from bt_agents_core.errors import BtAgentsError, Refused

MOST_LINES = 5000
"""Lines after which the file is written anew as one."""

MOST_BYTES = 64 * 2**20
"""A larger file is none of ours."""

_MOST_PROBLEMS = 20
_CLOSE_S = 5.0


class _Lines:
    """An open file of lines: each is in it as a whole or not at all.

    Attributes:
        size: Of its whole lines [bytes].
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self.descriptor = descriptor
        self.size = os.fstat(descriptor).st_size
        self._torn = False

    def write(self, line: bytes) -> None:
        """Write a line that counts when the size says so."""
        if self._torn:
            os.ftruncate(self.descriptor, self.size)
            self._torn = False
        while line:
            line = line[os.write(self.descriptor, line) :]

    def take_back(self) -> None:
        """Remove what does not count, now or before the next line."""
        self._torn = True
        with suppress(OSError):
            os.ftruncate(self.descriptor, self.size)
            self._torn = False


class Journal:
    """An open file of tunings; nobody else can open it meanwhile.

    A line that is written outlives the process at once, and a power cut as soon as the disk has
    it. Only ``disk`` waits for that, nobody else.

    Args:
        path: Made, with its folder, when it is not there.
        disk: Does one thing after the other, in a thread of its own.
        tell: Takes words for the log.

    Attributes:
        problems: What was wrong with the file when it was opened, in words, with the line.

    Raises:
        BtAgentsError: It cannot be opened, is too large, or another host has it open.
    """

    def __init__(self, path: Path, disk: Executor, tell: Callable[[str], None]) -> None:
        self.problems: list[str] = []
        self._path = path
        self._disk = disk
        self._tell = tell
        self._count = 0
        self._unsynced = False
        self._syncing: Job[None] = Job()
        self._syncing.set_result(None)
        self._renewal: Job[None] | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = _Lines(path, _locked(path))
            # While the file is written anew there are two, and each line goes to both.
            self._files: tuple[_Lines, ...] = (file,)
            try:
                if file.size > MOST_BYTES:
                    raise BtAgentsError(
                        f"{path} has {file.size} bytes, expected at most {MOST_BYTES}; "
                        "move it away"
                    )
                self.remembered = self._read(file)
            except BaseException:
                os.close(file.descriptor)
                raise
        except OSError as error:
            raise BtAgentsError(f"{path} cannot be opened: {error.strerror or error}") from error

    def append(self, revision: TuningRevision, defaults: Mapping[str, Setting]) -> None:
        """Write a revision; when this returns, it outlives the process.

        Raises:
            Refused: ``NOT_KEPT``: it cannot be written; the file is as before.
        """
        self._append(revision_line(revision, defaults))
        self._unsynced = True

    def agree(self, name: str) -> None:
        """Write that a file has a tuned value as its default now; as :meth:`append`.

        It needs no :meth:`sync`: when it is lost, the next start notices it again.

        Raises:
            Refused: ``NOT_KEPT``.
        """
        self._append(agreed_line(name))

    def sync(self) -> Job[None]:
        """Return a job that has ended when every revision so far outlives a power cut.

        It is one for all that is written before it begins. Its error is an ``OSError``.
        """
        begun = self._syncing.running() or self._syncing.done()
        if self._unsynced and begun:
            self._syncing = self._disk.submit(self._sync)
        self._unsynced = False
        return self._syncing

    def _sync(self) -> None:
        for file in self._files:
            os.fdatasync(file.descriptor)

    def _append(self, text: str) -> None:
        self._take_renewed()
        line = text.encode()
        try:
            for file in self._files:
                file.write(line)
        except OSError as error:
            for file in self._files:
                file.take_back()
            raise Refused(
                "NOT_KEPT",
                f"{self._path} cannot be written: {error.strerror or error}; nothing is changed, "
                "because it would be lost with the host",
            ) from error
        for file in self._files:
            file.size += len(line)
        self._count += 1

    @property
    def is_long(self) -> bool:
        """True when the file is to be written anew, see :meth:`shorten`."""
        return self._count > MOST_LINES and self._renewal is None

    def shorten(self, remembered: Overrides) -> None:
        """Begin to write the file anew, as one line; until then the old file is there.

        Raises:
            OSError: It cannot be written.
        """
        self._count = 0
        text = state_line(remembered).encode()
        path = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        opened = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_TRUNC, 0o644)
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
            fresh = _Lines(path, opened)
            fresh.write(text)
        except BaseException:
            os.close(opened)
            path.unlink(missing_ok=True)
            raise
        fresh.size = len(text)
        self._files = (*self._files, fresh)
        self._renewal = self._disk.submit(self._put_in_place, fresh)

    def _put_in_place(self, fresh: _Lines) -> None:
        try:
            os.fsync(fresh.descriptor)
            os.replace(fresh.path, self._path)
        except BaseException:
            fresh.path.unlink(missing_ok=True)
            raise
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            with suppress(OSError):
                os.fsync(folder)
        finally:
            os.close(folder)

    def _take_renewed(self) -> None:
        """Write to one file again when the other one is in its place."""
        if self._renewal is None or not self._renewal.done():
            return
        error = self._renewal.exception()
        self._renewal = None
        old, fresh = self._files
        if error is not None:
            old, fresh = fresh, old
            self._tell(f"the file of tunings grows, it cannot be written anew: {error}")
        self._files = (fresh,)
        # A sync of both may be under way.
        self._disk.submit(os.close, old.descriptor)

    def close(self) -> None:
        """Let others have the file; the disk is waited for, but not for ever."""
        jobs = [self.sync(), *([self._renewal] if self._renewal is not None else [])]
        wait(jobs, _CLOSE_S)
        self._take_renewed()
        for file in self._files:
            os.close(file.descriptor)

    def _read(self, file: _Lines) -> Overrides:
        content = os.pread(file.descriptor, file.size, 0)
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            self._problem(content.count(b"\n") + 1, "its end is missing; it is left out")
            os.ftruncate(file.descriptor, whole)
            file.size = whole
        remembered = Overrides()
        for number, line in enumerate(content[:whole].split(b"\n")[:-1], start=1):
            self._count += 1
            try:
                remembered = take_line(line.decode(), remembered)
            except UnicodeDecodeError:
                self._problem(number, "no UTF-8; it is left out")
            except Refused as refused:
                self._problem(number, f"{refused.reason}; it is left out")
        return remembered

    def _problem(self, line: int, words: str) -> None:
        if len(self.problems) < _MOST_PROBLEMS:
            self.problems.append(f"{self._path}:{line}: {words}")
        elif len(self.problems) == _MOST_PROBLEMS:
            self.problems.append(f"{self._path}: and more lines that cannot be read")


def _locked(path: Path) -> int:
    opened = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(opened)
        raise BtAgentsError(
            f"{path} is in use by another host; give each host a file of its own (parameter "
            "'tunings')"
        ) from None
    return opened
