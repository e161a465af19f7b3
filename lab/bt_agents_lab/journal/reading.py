# SPDX-License-Identifier: Apache-2.0
"""Reads a journal, whole or torn, without ROS."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from mcap.records import Channel, Chunk, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap_ros2.decoder import DecoderFactory

from bt_agents.errors import BtAgentsError
from bt_agents_lab.journal.layout import LIBRARY

_LARGEST_RECORD = 1 << 30
_LARGEST_CHUNK = 1 << 28


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One message of a journal.

    Attributes:
        topic: Its full name.
        type: ``package/msg/Name``.
        sent_ns: When it was sent [ns since 1970].
        heard_ns: When it was heard [ns since 1970].
        lost: How many messages of its topic the journal found no room for, right before it.
        data: As it was sent.
        decode: Returns it with its fields as attributes; may raise.
    """

    topic: str
    type: str
    sent_ns: int
    heard_ns: int
    lost: int
    data: bytes
    decode: Callable[[], Any]


class JournalReader:
    """The messages of some files, in the order in which they were sent.

    A message that is there twice, as a fact is that a journal heard again after its restart, is
    given once.

    Args:
        paths: The files.

    Attributes:
        problems: What could not be read, in words; complete after reading.

    Raises:
        BtAgentsError: A file cannot be opened.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.problems: list[str] = []
        self._paths = paths
        for path in paths:
            try:
                with path.open("rb"):
                    pass
            except OSError as error:
                raise BtAgentsError(f"no journal {path}: {error.strerror}") from None

    def entries(self) -> list[Entry]:
        """Return all messages."""
        seen: set[tuple[str, int, int]] = set()
        found = []
        for path in self._paths:
            for entry in self._of_file(path):
                key = (entry.topic, entry.sent_ns, zlib.crc32(entry.data))
                if key not in seen:
                    seen.add(key)
                    found.append(entry)
        return sorted(found, key=lambda entry: entry.sent_ns)

    def _of_file(self, path: Path) -> Iterator[Entry]:
        with path.open("rb") as file:
            schemas: dict[int, Schema] = {}
            channels: dict[int, Channel] = {}
            decoders = DecoderFactory()
            numbers = _Numbers()
            for record in self._records(path, file):
                match record:
                    case Header():
                        numbers.ours = record.library == LIBRARY
                    case Schema():
                        schemas[record.id] = record
                    case Channel():
                        channels[record.id] = record
                    case Message(channel_id=number) if number in channels:
                        channel = channels[number]
                        schema = schemas.get(channel.schema_id)
                        if schema is not None:
                            lost = numbers.lost_before(record)
                            yield _entry(record, channel, schema, decoders, lost)

    def _records(self, path: Path, file: BinaryIO) -> Iterator[McapRecord]:
        """Give the records of a file up to where it cannot be read any more."""
        reader = StreamReader(file, emit_chunks=True, record_size_limit=_LARGEST_RECORD)
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    yield from self._of_chunk(path, record)
                else:
                    yield record
        except Exception as error:
            # Whatever a decoder makes of broken bytes.
            why = str(error) or type(error).__name__
            self.problems.append(f"{path} can be read to byte {file.tell()} only: {why}")

    def _of_chunk(self, path: Path, chunk: Chunk) -> list[McapRecord]:
        try:
            if chunk.uncompressed_size > _LARGEST_CHUNK:
                raise ValueError(f"it is said to hold {chunk.uncompressed_size} bytes")
            return breakup_chunk(chunk, validate_crc=True)
        except Exception as error:
            self.problems.append(f"{path} has a part that cannot be read: {error}")
            return []


class _Numbers:
    """The numbers of the messages of a file, which show what is lost.

    Each start of a journal, and each file, counts the messages of every topic from 1.

    Attributes:
        ours: Whether a journal wrote the file; others may count otherwise.
    """

    def __init__(self) -> None:
        self.ours = False
        self._last: dict[int, int] = {}

    def lost_before(self, message: Message) -> int:
        """Return how many messages of the same topic are missing before one."""
        before = self._last.get(message.channel_id, 0)
        self._last[message.channel_id] = message.sequence
        if not self.ours or message.sequence <= before:
            before = 0
        return max(message.sequence - before - 1, 0) if self.ours else 0


def _entry(
    message: Message, channel: Channel, schema: Schema, decoders: DecoderFactory, lost: int
) -> Entry:
    def decode() -> Any:
        decoder = decoders.decoder_for(channel.message_encoding, schema)
        if decoder is None:
            raise BtAgentsError(
                f"{channel.topic} is written as {channel.message_encoding} with a "
                f"{schema.encoding} schema, expected cdr with ros2msg"
            )
        return decoder(message.data)

    return Entry(
        topic=channel.topic,
        type=schema.name,
        sent_ns=message.publish_time,
        heard_ns=message.log_time,
        lost=lost,
        data=message.data,
        decode=decode,
    )
