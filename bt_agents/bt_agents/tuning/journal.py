# SPDX-License-Identifier: Apache-2.0
"""The file in which tuning outlives the host: one line a change, on the disk before it counts."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Mapping
from pathlib import Path

from bt_agents.errors import BtAgentsError, Refused
from bt_agents.tuning.history import Revision
from bt_agents.tuning.journal_lines import agreed_line, revision_line, state_line, take_line
from bt_agents.tuning.knobs import Setting
from bt_agents.tuning.remembered import Remembered

MOST_LINES = 5000
"""Lines after which the file is written anew as one."""

MOST_BYTES = 64 * 2**20
"""A larger file is none of ours."""

_MOST_PROBLEMS = 20


class Journal:
    """An open file of tunings; nobody else can open it meanwhile.

    Args:
        path: Made, with its folder, when it is not there.

    Attributes:
        problems: What was wrong with the file when it was opened, in words, with the line.

    Raises:
        BtAgentsError: It cannot be opened, is too large, or another host has it open.
    """

    def __init__(self, path: Path) -> None:
        self.problems: list[str] = []
        self._path = path
        self._lines = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = _locked(path)
            try:
                self._size = os.fstat(self._file).st_size
                if self._size > MOST_BYTES:
                    raise BtAgentsError(
                        f"{path} has {self._size} bytes, expected at most {MOST_BYTES}; "
                        "move it away"
                    )
                self.remembered = self._read()
            except BaseException:
                os.close(self._file)
                raise
        except OSError as error:
            raise BtAgentsError(f"{path} cannot be opened: {error.strerror or error}") from error

    def append(self, revision: Revision, defaults: Mapping[str, Setting]) -> None:
        """Write a revision; when this returns, it outlives a power cut.

        Raises:
            Refused: ``NOT_KEPT``: it cannot be written; the file is as before.
        """
        self._append(revision_line(revision, defaults))

    def agree(self, name: str) -> None:
        """Write that a file has a tuned value as its default now; as :meth:`append`.

        Raises:
            Refused: ``NOT_KEPT``.
        """
        self._append(agreed_line(name))

    def _append(self, text: str) -> None:
        line = text.encode()
        try:
            _write(self._file, line)
            os.fdatasync(self._file)
        except OSError as error:
            os.ftruncate(self._file, self._size)
            raise Refused(
                "NOT_KEPT",
                f"{self._path} cannot be written: {error.strerror or error}; nothing is changed, "
                "because it would be lost with the host",
            ) from error
        self._size += len(line)
        self._lines += 1

    @property
    def is_long(self) -> bool:
        """True when the file is to be written anew, see :meth:`shorten`."""
        return self._lines > MOST_LINES

    def shorten(self, remembered: Remembered) -> None:
        """Write the file anew, as one line.

        Raises:
            OSError: It cannot be written; the old file is still there.
        """
        self._lines = 0
        text = state_line(remembered).encode()
        fresh = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        opened = os.open(fresh, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_TRUNC, 0o644)
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _write(opened, text)
            os.fsync(opened)
            os.replace(fresh, self._path)
        except BaseException:
            os.close(opened)
            fresh.unlink(missing_ok=True)
            raise
        os.close(self._file)
        self._file, self._size = opened, len(text)

    def close(self) -> None:
        """Let others have the file."""
        os.close(self._file)

    def _read(self) -> Remembered:
        content = os.pread(self._file, self._size, 0)
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            self._problem(content.count(b"\n") + 1, "its end is missing; it is left out")
            os.ftruncate(self._file, whole)
            self._size = whole
        remembered = Remembered()
        for number, line in enumerate(content[:whole].split(b"\n")[:-1], start=1):
            self._lines += 1
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


def _write(opened: int, content: bytes) -> None:
    while content:
        content = content[os.write(opened, content) :]
