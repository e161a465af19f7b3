# SPDX-License-Identifier: Apache-2.0
"""Log files of the processes of a system: private, and bounded in size and number."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from bt_agents_core.person_mention import PersonMention
from bt_agents_core.private_files import make_private_folder, open_private
from bt_agents_core.state_folder import state_home
from bt_agents_core.text import printable

MOST_BYTES = 8_000_000
"""A log file of this size is rotated [bytes]."""

MOST_FOLDERS = 20
"""Number of log folders to keep, in addition to running systems."""

_FOLDER = re.compile(r"\d{4}-\d\d-\d\d-\d{6}-(\d+)")
_TAIL_BYTES = 16_384
_LONGEST_LINE = 500


class LogFile:
    """Log file of a component; every start appends to it, and only its end is read.

    Lines older than the last :data:`MOST_BYTES` are in one file next to it, ``….log.1``.
    """

    def __init__(self, path: Path, most_bytes: int = MOST_BYTES) -> None:
        self.path = path
        self._most_bytes = most_bytes
        self._begin = 0
        # Size and time of change of the file when its last line was read.
        self._read_at = (-1, -1)
        self._last_line = ""

    @property
    def older(self) -> Path:
        """File of the last rotated lines."""
        return self.path.with_name(f"{self.path.name}.1")

    def open(self, start: int) -> BinaryIO:
        """Return the file for the output of a start of the process, counted from 1."""
        log = os.fdopen(open_private(self.path, os.O_WRONLY | os.O_APPEND), "ab")
        if start > 1:
            log.write(f"--- start {start}, {time.strftime('%Y-%m-%d %H:%M:%S')}\n".encode())
            log.flush()
        self._begin = log.tell()
        return log

    def rotate(self) -> None:
        """Move the content of a file that is too large into :attr:`older`, which it replaces.

        The process keeps appending, so that its next line is the first of the emptied file. Output
        in the moment between the last copy and the emptying is lost.
        """
        try:
            if self.path.stat().st_size < self._most_bytes:
                return
            with (
                open(self.path, "r+b", buffering=0) as log,
                os.fdopen(open_private(self.older, os.O_WRONLY | os.O_TRUNC), "wb") as older,
            ):
                log.seek(max(0, os.fstat(log.fileno()).st_size - self._most_bytes))
                shutil.copyfileobj(log, older)
                log.truncate(0)
        except OSError:
            # A full disk: the next poll tries again, and nothing is lost meanwhile.
            return
        self._begin = 0

    def tail(self, lines: int) -> list[str]:
        """Return the last lines since the last start, however large the file is."""
        try:
            with self.path.open("rb") as log:
                size = log.seek(0, os.SEEK_END)
                log.seek(max(self._begin, size - _TAIL_BYTES))
                text = log.read(_TAIL_BYTES).decode(errors="replace")
        except OSError as error:
            return [f"(the log cannot be read: {error.strerror})"]
        return [printable(line[:_LONGEST_LINE]) for line in text.splitlines()[-lines:]]

    def last_line(self) -> str:
        """Return the last line since the last start; read only after a change of the file."""
        try:
            found = self.path.stat()
        except OSError:
            return ""
        if (found.st_size, found.st_mtime_ns) != self._read_at:
            self._read_at = (found.st_size, found.st_mtime_ns)
            self._last_line = next(iter(self.tail(1)), "")
        return self._last_line


def new_log_folder(state: str = "") -> Path:
    """Return the path of a log folder for this start, in a state folder; make nothing."""
    return log_home(state) / f"{time.strftime('%Y-%m-%d-%H%M%S')}-{os.getpid()}"


def log_home(state: str = "") -> Path:
    """Return the folder of all log folders, in a state folder."""
    return (Path(state).expanduser().resolve() if state else state_home()) / "logs"


def make_log_folder(folder: Path) -> None:
    """Make the log folder of a start; delete the folders of the oldest ended starts.

    Raises:
        OSError: It cannot be made.
    """
    make_private_folder(folder, within=folder.parent if folder.parent.name == "logs" else folder)
    for old in ended(folder.parent, is_running)[:-MOST_FOLDERS]:
        shutil.rmtree(old, ignore_errors=True)


def ended(home: Path, runs: Callable[[int], bool]) -> list[Path]:
    """Return the log folders of starts whose process no longer ``runs``, oldest first."""
    return sorted(folder for folder, process in _folders(home) if not runs(process))


def erase_lines(home: Path, person: PersonMention) -> dict[Path, int]:
    """Remove the lines that name a person from all log files; return their number by file.

    A file is changed in place, because a running process appends to it. Output in the moment
    between the last read and the new end may be lost.

    Raises:
        OSError: A file cannot be written.
    """
    erased: dict[Path, int] = {}
    for folder, _ in sorted(_folders(home)):
        for path in sorted(folder.glob("*.log*")):
            with open(path, "r+b", buffering=0) as log:
                before = log.readall()
                lines = before.splitlines(keepends=True)
                kept = [line for line in lines if not person.is_in(line.decode(errors="replace"))]
                if len(kept) == len(lines):
                    continue
                text = b"".join(kept) + log.readall()
                log.seek(0)
                log.write(text)
                log.truncate(len(text))
                erased[path] = len(lines) - len(kept)
    return erased


def is_running(process: int) -> bool:
    """Return whether a process of this user has an id."""
    with suppress(ProcessLookupError):
        with suppress(PermissionError):
            os.kill(process, 0)
        return True
    return False


def _folders(home: Path) -> Iterator[tuple[Path, int]]:
    with suppress(OSError):
        for folder in home.iterdir():
            match = _FOLDER.fullmatch(folder.name)
            if match is not None and folder.is_dir() and not folder.is_symlink():
                yield folder, int(match[1])
