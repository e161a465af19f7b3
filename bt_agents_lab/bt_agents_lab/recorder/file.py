# SPDX-License-Identifier: Apache-2.0
"""MCAP file of a journal, written in complete flushes, with the definitions of its types."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer

from bt_agents_core.errors import Refused
from bt_agents_core.private_files import make_private_folder, open_private
from bt_agents_core.refusal_codes import RefusalCode

PROGRAM = "bt-agents"
"""Prefix of the writer's name in the header of each journal, of any format."""

LIBRARY = f"{PROGRAM} journal 3"
"""Name of the writer in the header of a file, with the format of its messages."""

QOS = "offered_qos_profiles"
"""Key in the metadata of a channel with the QoS that ``ros2 bag play`` publishes with."""

Write = Callable[[int, bytes, int], int]
"""Function like :func:`os.pwrite`."""

Lookup = Callable[[str], str | None]
"""Function that returns the definition of a type by its full name, or None."""

_RULE = "=" * 80
_FIELD = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_/]*)(?:\[[^\]]*\])?\s+[A-Za-z_]")
_PRIMITIVE = re.compile(r"(?:bool|byte|char|w?string|(?:u?int(?:8|16|32|64))|float(?:32|64))\b")
_LONGEST = 1_000_000


@dataclass(frozen=True, kw_only=True)
class RecordedTopic:
    """Topic that is recorded.

    Attributes:
        type: ``package/msg/Name``.
        definition: Definition of the type, followed by the types in it.
        qos: QoS of its publishers, as ``ros2 bag`` reads it; empty for its default.
    """

    name: str
    type: str
    definition: str
    qos: str = ""


@dataclass(frozen=True, kw_only=True)
class RecordedMessage:
    """Message as it was sent.

    Attributes:
        data: Serialized message (CDR).
        sent_ns: When it was sent [ns since 1970].
        received_ns: When it was received [ns since 1970].
    """

    topic: RecordedTopic
    data: bytes
    sent_ns: int
    received_ns: int


class JournalFile:
    """New MCAP file; messages wait in memory until a flush writes all of them or none.

    Attributes:
        waiting: Number of messages that are not in the file yet.

    Raises:
        OSError: The file exists or cannot be written.
    """

    def __init__(self, path: Path, write: Write = os.pwrite) -> None:
        self.path = path
        self.waiting = 0
        self._write = write
        self._unwritten = _Unwritten()
        self._writer = Writer(self._unwritten)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._schemas: dict[tuple[str, str], int] = {}
        self._channels: dict[RecordedTopic, int] = {}
        make_private_folder(path.parent)
        self._file = open_private(path, os.O_RDWR | os.O_EXCL)
        try:
            self._write_out()
        except BaseException:
            os.close(self._file)
            path.unlink()
            raise

    def add(self, message: RecordedMessage, sequence: int) -> None:
        """Take a message for the next flush, with its sequence number in its topic."""
        self._writer.add_message(
            channel_id=self._channel(message.topic),
            log_time=message.received_ns,
            data=message.data,
            publish_time=message.sent_ns,
            sequence=sequence,
        )
        self.waiting += 1

    def flush(self) -> None:
        """Write the waiting messages; raises OSError, and then the file is unchanged."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._write_out()
        self.waiting = 0

    def close(self) -> int:
        """Write the messages that fit, and the summary; return the number of lost messages."""
        try:
            with suppress(OSError):
                self.flush()
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._write_out()
        finally:
            os.close(self._file)
        return self.waiting

    def _channel(self, topic: RecordedTopic) -> int:
        if topic not in self._channels:
            schema = (topic.type, topic.definition)
            if schema not in self._schemas:
                self._schemas[schema] = self._writer.register_schema(
                    name=topic.type, encoding=SchemaEncoding.ROS2, data=topic.definition.encode()
                )
            self._channels[topic] = self._writer.register_channel(
                topic=topic.name,
                message_encoding=MessageEncoding.CDR,
                schema_id=self._schemas[schema],
                metadata={QOS: topic.qos} if topic.qos else {},
            )
        return self._channels[topic]

    def _write_out(self) -> None:
        """Append the writer's output to the file, all or nothing; raises OSError."""
        data, end = self._unwritten.getvalue(), self._unwritten.start
        done = 0
        try:
            while done < len(data):
                done += self._write(self._file, data[done:], end + done)
        except OSError:
            os.ftruncate(self._file, end)
            raise
        self._unwritten.drop()


class _Unwritten(BytesIO):
    """Output of the MCAP writer that is not in the file yet.

    Attributes:
        start: Its offset in the file.
    """

    start = 0

    def tell(self) -> int:
        return self.start + super().tell()

    def drop(self) -> None:
        self.start = self.tell()
        self.seek(0)
        self.truncate()


def definition(type_name: str, lookup: Lookup) -> str:
    """Return the definition of a type, followed by the types in it.

    They are separated as rosbag2 and Foxglove expect: a line of 80 ``=``, ``MSG: pkg/Name``.

    Raises:
        Refused: ``NO_DEFINITION``.
    """
    known = cache(lookup)
    parts: list[str] = []
    seen = [type_name]
    # The list grows during the loop.
    for name in seen:
        text = known(name)
        if text is None or len(text) > _LONGEST:
            raise Refused(
                RefusalCode.NO_DEFINITION,
                f"there is no definition of {name}, which {type_name} needs; is its package "
                "installed with its msg files?",
            )
        package, _, short = name.split("/")
        parts.append(f"{_RULE}\nMSG: {package}/{short}\n{text}" if parts else text)
        seen += [used for used in _used(text, package) if used not in seen]
    return "\n".join(part.rstrip("\n") for part in parts) + "\n"


def _used(text: str, package: str) -> list[str]:
    """Return the full names of the field types in a definition."""
    found: dict[str, None] = {}
    for line in text.splitlines():
        match = _FIELD.match(line.partition("#")[0])
        if match is None or _PRIMITIVE.match(match[1]):
            continue
        parts = match[1].split("/")
        home = package if len(parts) == 1 else parts[0]
        found[f"{home}/msg/{parts[-1]}"] = None
    return list(found)
