# SPDX-License-Identifier: Apache-2.0
"""Which file of the journal is written: one a day, each complete in itself, the oldest dropped."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from mcap.records import Message

from bt_agents_core.errors import STORAGE_FULL, Refused
from bt_agents_lab.recorder.file import JournalFile, Write

MOST_WAITING = 32_000_000
"""Bytes that wait in memory while nothing can be written; after that the newest are dropped."""

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
_FULL = (STORAGE_FULL, "there is room")
_FAILED = ("STORAGE_FAILED", "it can be written again")
_NAME = re.compile(r"journal-(\d{4}-\d\d-\d\d)\.mcap")


@dataclass(frozen=True, kw_only=True)
class RecordedTopic:
    """A topic that is kept.

    Attributes:
        name: Its full name.
        type: ``package/msg/Name``.
        definition: Text of the type, followed by those that it uses.
    """

    name: str
    type: str
    definition: str


@dataclass(frozen=True, kw_only=True)
class RecordedMessage:
    """One message.

    Attributes:
        topic: On which it was said.
        data: As it was sent.
        sent_ns: When it was sent [ns since 1970].
        heard_ns: When it was heard [ns since 1970].
    """

    topic: RecordedTopic
    data: bytes
    sent_ns: int
    heard_ns: int


class DailyRecorder:
    """Keeps what is said; a full disk costs what is said meanwhile, and nothing else.

    Args:
        folder: For the files.
        days: How many files are kept; 0 keeps all.
        today: Returns the local date.
        tell: Takes words for people, and whether something is wrong.
        write: See :class:`JournalFile`.

    Attributes:
        dropped: Messages that found no room since the last that did.
    """

    def __init__(
        self,
        folder: Path,
        *,
        days: int,
        today: Callable[[], date],
        tell: Callable[[str, bool], None],
        write: Write = os.pwrite,
    ) -> None:
        self.dropped = 0
        self._folder = folder
        self._days = days
        self._today = today
        self._tell = tell
        self._write = write
        self._facts: dict[str, RecordedMessage] = {}
        self._numbers: dict[str, int] = {}
        self._bytes = 0
        self._trouble = ""
        self._date = today()
        self._file = self._open()

    @property
    def path(self) -> Path:
        """The file of today."""
        return self._file.path

    def take(self, said: RecordedMessage, *, fact: str = "") -> None:
        """Take a message.

        Args:
            said: The message.
            fact: Under which it is kept for the files of the days to come, as it stays true until
                the next one of this key; empty for what only happens.
        """
        if not self._trouble:
            try:
                self._turn_page(said.heard_ns)
            except OSError as error:
                self._warn(error)
        if fact:
            self._facts[fact] = said
        self._add(said)

    def flush(self, now_ns: int) -> None:
        """Write what was taken.

        Args:
            now_ns: Now [ns since 1970].
        """
        try:
            self._write_down()
            self._turn_page(now_ns)
            self._write_down()
        except OSError as error:
            self._warn(error)
            return
        if self._trouble:
            self._trouble = ""
            lost = f"; {self.dropped} messages are lost" if self.dropped else ""
            self._tell(f"the journal goes on in {self.path}{lost}", bool(lost))
            self.dropped = 0

    def close(self) -> None:
        """Write what was taken and leave the file; say what is lost."""
        lost = self.dropped + self._file.close()
        if lost:
            self._tell(
                f"{lost} messages are lost: {self.path} could not be written before the end", True
            )

    def _write_down(self) -> None:
        self._file.flush()
        self._bytes = 0

    def _add(self, said: RecordedMessage) -> None:
        # Lost messages leave a gap in the numbers.
        number = self._numbers[said.topic.name] = self._numbers.get(said.topic.name, 0) + 1
        if self._bytes + len(said.data) > MOST_WAITING:
            self.dropped += 1
            return
        topic = said.topic
        try:
            channel = self._file.channel(topic.name, topic.type, topic.definition)
        except OSError as error:
            self._warn(error)
            self.dropped += 1
            return
        self._bytes += len(said.data)
        self._file.add(
            Message(
                channel_id=channel,
                log_time=said.heard_ns,
                data=said.data,
                publish_time=said.sent_ns,
                sequence=number % 2**32,
            )
        )

    def _turn_page(self, now_ns: int) -> None:
        """Begin the file of another day with what is still true; raises OSError.

        The file of the day before is left only when all that was taken for it is in it.
        """
        today = self._today()
        if today == self._date:
            return
        self._write_down()
        before, self._date = self._date, today
        try:
            following = self._open()
        except OSError:
            self._date = before
            raise
        except Refused as refused:
            self._date = before
            raise OSError(errno.EBUSY, refused.reason) from refused
        self._file.close()
        self._file = following
        self._numbers.clear()
        for said in self._facts.values():
            self._add(
                RecordedMessage(
                    topic=said.topic, data=said.data, sent_ns=said.sent_ns, heard_ns=now_ns
                )
            )

    def _open(self) -> JournalFile:
        file = JournalFile(self._folder / f"journal-{self._date:%Y-%m-%d}.mcap", self._write)
        if file.aside is not None:
            self._tell(
                f"the end of {file.path} could not be read and is kept in {file.aside}", True
            )
        self._drop_old()
        return file

    def _drop_old(self) -> None:
        if not self._days:
            return
        found = sorted(path for path in self._folder.iterdir() if _NAME.fullmatch(path.name))
        for path in found[: -self._days]:
            try:
                path.unlink()
            except OSError as error:
                self._tell(f"{path} is old but cannot be deleted: {error.strerror}", True)
            else:
                self._tell(f"{path.name} is deleted, {self._days} days are kept", False)

    def _warn(self, error: OSError) -> None:
        """Say once that nothing can be written."""
        trouble = error.strerror or str(error)
        if trouble != self._trouble:
            self._trouble = trouble
            code, until = _FULL if error.errno in _NO_ROOM else _FAILED
            self._tell(
                f"{code}: {self._folder} cannot be written ({trouble}); the journal waits in "
                f"memory and goes on when {until}",
                True,
            )
