# SPDX-License-Identifier: Apache-2.0
"""One MCAP file that is only ever added to, also after a crash and by the next start."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding

from bt_agents_core.errors import Refused
from bt_agents_lab.recorder.mcap_format import chunk_of, head, packed, tail
from bt_agents_lab.recorder.scan import survey

Write = Callable[[int, bytes, int], int]
"""As :func:`os.pwrite`."""


class JournalFile:
    """Adds messages to a file; what cannot be read of an earlier one is put aside, never lost.

    Messages wait in memory for :meth:`flush`, which writes them all or none.

    Args:
        path: Where it is; made if there is none.
        write: Writes at a place of the file.

    Attributes:
        aside: File with the bytes that could not be read; None when all could.
        waiting: Messages that are not in the file yet.

    Raises:
        Refused: ``IN_USE``; another journal writes it. OSError as of any file.
    """

    def __init__(self, path: Path, write: Write = os.pwrite) -> None:
        self.path = path
        self.aside: Path | None = None
        self.waiting: list[Message] = []
        self._write = write
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            self._lock()
            self._end = self._continue()
        except BaseException:
            os.close(self._file)
            raise

    def channel(self, topic: str, type_name: str, definition: str) -> int:
        """Return the id of a topic, which is written down when it is new.

        Args:
            topic: Its full name.
            type_name: ``package/msg/Name``.
            definition: Text of the type, followed by those that it uses.
        """
        for channel in self._contents.channels.values():
            schema = self._contents.schemas.get(channel.schema_id)
            if (
                channel.topic == topic
                and schema is not None
                and _is(schema, type_name, definition)
            ):
                return channel.id
        schema = self._schema(type_name, definition)
        new = Channel(
            id=max(self._contents.channels, default=0) + 1,
            topic=topic,
            message_encoding=MessageEncoding.CDR,
            metadata={},
            schema_id=schema.id,
        )
        self._add(packed(new))
        self._contents.channels[new.id] = new
        return new.id

    def add(self, message: Message) -> None:
        """Take a message, for the next flush."""
        self.waiting.append(message)

    def flush(self) -> None:
        """Write what waits; raises OSError, and then the file is as it was before."""
        if not self.waiting:
            return
        chunk, indexes = chunk_of(self.waiting)
        record = packed(chunk)
        at = self._end
        self._add(record + packed(*indexes))
        self._contents.note(chunk, len(record), at, indexes)
        self.waiting = []

    def close(self) -> int:
        """Write what waits and the summary, as far as there is room, and leave the file.

        Returns:
            How many messages found no room.
        """
        try:
            with suppress(OSError):
                self.flush()
                end = self._end
                self._add(tail(self._contents, end))
                self._end = end
        finally:
            os.close(self._file)
        return len(self.waiting)

    def _schema(self, type_name: str, definition: str) -> Schema:
        for schema in self._contents.schemas.values():
            if _is(schema, type_name, definition):
                return schema
        new = Schema(
            id=max(self._contents.schemas, default=0) + 1,
            data=definition.encode(),
            encoding=SchemaEncoding.ROS2,
            name=type_name,
        )
        self._add(packed(new))
        self._contents.schemas[new.id] = new
        return new

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise Refused(
                "IN_USE", f"another journal writes {self.path}; end it, or name another folder"
            ) from None

    def _continue(self) -> int:
        """Make ready to add to what is there; return where."""
        with open(self._file, "rb", closefd=False) as file:
            found = survey(file)
        self._contents = found.contents
        self._end = found.end
        if not found.whole:
            self._put_aside(found.end)
        os.ftruncate(self._file, found.end)
        self._add(found.missing if found.end else head())
        return self._end

    def _put_aside(self, start: int) -> None:
        """Keep the bytes from somewhere on in a file of their own."""
        number = 1
        while True:
            self.aside = self.path.with_name(f"{self.path.name}.torn-{number}")
            try:
                with self.aside.open("xb") as kept, self.path.open("rb") as file:
                    file.seek(start)
                    while block := file.read(1 << 20):
                        kept.write(block)
                return
            except FileExistsError:
                number += 1

    def _add(self, data: bytes) -> None:
        """Write at the end, everything or nothing; raises OSError."""
        done = 0
        try:
            while done < len(data):
                done += self._write(self._file, data[done:], self._end + done)
        except OSError:
            os.ftruncate(self._file, self._end)
            raise
        self._end += len(data)


def _is(schema: Schema, type_name: str, definition: str) -> bool:
    return schema.name == type_name and schema.data == definition.encode()
