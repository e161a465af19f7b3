# SPDX-License-Identifier: Apache-2.0
"""Recorder of a journal: one self-contained file for each start and day."""

from __future__ import annotations

import errno
import fcntl
import os
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path

from bt_agents_core.errors import Refused
from bt_agents_core.health import Health, PartHealth
from bt_agents_core.private_files import make_private_folder
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_lab.recorder.file import JournalFile, RecordedMessage, Write

MOST_WAITING = 32_000_000
"""Most bytes that wait in memory while writing fails; then the newest messages are dropped."""

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
_FULL = (RefusalCode.STORAGE_FULL, "there is room")
_FAILED = (RefusalCode.STORAGE_FAILED, "it can be written again")
_NAME = re.compile(r"journal-(\d{4}-\d\d-\d\d)(?:_(\d{3,}))?\.mcap")


class DailyRecorder:
    """Recorder of messages; a full disk loses only the messages that arrive meanwhile.

    It records until it is stopped. While it is stopped, it remembers current facts, so that the
    file of the next start is self-contained.

    Args:
        days: Number of days whose files are kept; 0 keeps all.
        today: Returns the local date.
        report: Takes a text for people, and whether it is an error.

    Attributes:
        is_recording: False while it is stopped.

    Raises:
        Refused: ``IN_USE``; another journal writes into the folder.
        OSError: The folder cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        *,
        days: int,
        today: Callable[[], date],
        report: Callable[[str, bool], None],
        write: Write = os.pwrite,
    ) -> None:
        self._folder = folder
        self._days = days
        self._today = today
        self._report = report
        self._write = write
        self._facts: dict[str, RecordedMessage] = {}
        self._sequences: dict[str, int] = {}
        self._bytes = 0
        self._dropped = 0
        self._trouble = ""
        self._begin()

    @property
    def path(self) -> Path:
        """File of this start and day; while stopped, the last one."""
        return self._file.path

    @property
    def health(self) -> PartHealth:
        """Whether it records everything and can write."""
        level, message = Health.OK, "everything is recorded"
        if self._trouble:
            level, message = Health.ERROR, f"{self.path.name} cannot be written: {self._trouble}"
        elif not self.is_recording:
            message = "the recording is stopped"
        values = {"file": self.path.name, "dropped": str(self._dropped)}
        return PartHealth(part="recording", level=level, message=message, values=values)

    def record(self, message: RecordedMessage, *, fact: str = "") -> None:
        """Take a message for the next flush.

        A fact holds until the next message with the same key, so it is repeated at the beginning
        of later files; an event has no key.
        """
        if self.is_recording and not self._trouble:
            try:
                self._change_file(message.received_ns)
            except OSError as error:
                self._warn(error)
        if fact:
            self._facts[fact] = message
        if self.is_recording:
            self._add(message)

    def forget(self, fact: str) -> None:
        """Stop repeating a fact."""
        self._facts.pop(fact, None)

    def start(self, now_ns: int) -> None:
        """Begin a new file after a stop, with the current facts; ``now_ns`` counts from 1970.

        Raises:
            Refused: ``IN_USE``; another journal writes into the folder.
            OSError: The folder cannot be written.
        """
        self._begin()
        self._repeat_facts(now_ns)

    def stop(self) -> None:
        """Write the waiting messages and end the file; report lost ones."""
        self.is_recording = False
        lost = self._dropped + self._file.close()
        os.close(self._lock)
        self._dropped, self._bytes, self._trouble = 0, 0, ""
        if lost:
            self._report(
                f"{lost} messages are lost: {self.path} could not be written before the end", True
            )

    def flush(self, now_ns: int) -> None:
        """Write the waiting messages; ``now_ns`` counts from 1970."""
        if not self.is_recording:
            return
        try:
            self._flush_file()
            self._change_file(now_ns)
            self._flush_file()
        except OSError as error:
            self._warn(error)
            return
        if self._trouble:
            self._trouble = ""
            lost = f"; {self._dropped} messages are lost" if self._dropped else ""
            self._report(f"the journal goes on in {self.path}{lost}", bool(lost))
            self._dropped = 0

    def close(self) -> None:
        """Stop a recording, if any."""
        if self.is_recording:
            self.stop()

    def _begin(self) -> None:
        """Lock the folder and begin a file in it; raises as the constructor."""
        self._lock = lock_folder(self._folder)
        self._date = self._today()
        try:
            self._file = self._open()
        except BaseException:
            os.close(self._lock)
            raise
        self.is_recording = True

    def _flush_file(self) -> None:
        self._file.flush()
        self._bytes = 0

    def _add(self, message: RecordedMessage) -> None:
        # Lost messages leave a gap in the sequence.
        name = message.topic.name
        sequence = self._sequences[name] = self._sequences.get(name, 0) + 1
        if self._bytes + len(message.data) > MOST_WAITING:
            self._dropped += 1
            return
        self._bytes += len(message.data)
        self._file.add(message, sequence % 2**32)

    def _change_file(self, now_ns: int) -> None:
        """Begin the file of another day with the current facts; raises OSError.

        The previous file is closed only once it has all of its messages.
        """
        today = self._today()
        if today == self._date:
            return
        self._flush_file()
        before, self._date = self._date, today
        try:
            following = self._open()
        except OSError:
            self._date = before
            raise
        self._file.close()
        self._file = following
        self._repeat_facts(now_ns)

    def _repeat_facts(self, now_ns: int) -> None:
        self._sequences.clear()
        for fact in self._facts.values():
            self._add(replace(fact, received_ns=now_ns))

    def _open(self) -> JournalFile:
        day = f"{self._date:%Y-%m-%d}"
        found = [match for match in _names(self._folder) if match[1] == day]
        start = 1 + max((int(match[2] or 0) for match in found), default=0)
        file = JournalFile(self._folder / f"journal-{day}_{start:03}.mcap", self._write)
        self._drop_old(day)
        return file

    def _drop_old(self, today: str) -> None:
        if not self._days:
            return
        found = _names(self._folder)
        # A wrong clock may have named files after later days.
        others = sorted({match[1] for match in found} - {today}, reverse=True)
        recent = {today, *others[: self._days - 1]}
        for match in found:
            if match[1] in recent:
                continue
            path = self._folder / match[0]
            try:
                path.unlink()
            except OSError as error:
                self._report(f"{path} is old but cannot be deleted: {error.strerror}", True)
            else:
                self._report(f"{path.name} is deleted, {self._days} days are kept", False)

    def _warn(self, error: OSError) -> None:
        """Report once that writing fails."""
        trouble = error.strerror or str(error)
        if trouble != self._trouble:
            self._trouble = trouble
            code, until = _FULL if error.errno in _NO_ROOM else _FAILED
            self._report(
                f"{code}: {self._folder} cannot be written ({trouble}); the journal waits in "
                f"memory and goes on when {until}",
                True,
            )


def newest_files(folder: Path) -> list[Path]:
    """Return the files of the newest day in a folder, oldest first; empty if there are none."""
    found = sorted(folder.glob("*.mcap"))
    newest = _NAME.fullmatch(found[-1].name) if found else None
    if newest is None:
        return found[-1:]
    names = [match for match in _names(folder) if match[1] == newest[1]]
    return [folder / match[0] for match in sorted(names, key=lambda match: int(match[2] or 0))]


def _names(folder: Path) -> list[re.Match[str]]:
    """Return the files in a folder that a journal wrote: name, day and start of each."""
    matches = [_NAME.fullmatch(path.name) for path in folder.iterdir()]
    return sorted(filter(None, matches), key=lambda match: match[0])


def lock_folder(folder: Path) -> int:
    """Return a lock on a folder, which lasts until it is closed or its process ends.

    Raises:
        Refused: ``IN_USE``; a journal writes into the folder.
    """
    make_private_folder(folder)
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise Refused(
            RefusalCode.IN_USE,
            f"another journal writes into {folder}; end it, or name another folder",
        ) from None
    return lock
