# SPDX-License-Identifier: Apache-2.0
"""Reader of journals, whole or torn, without ROS."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Chunk, Footer, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap_ros2.decoder import DecoderFactory

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.recorder.file import LIBRARY

MOST_UNPACKED = 1 << 26
"""Bytes that a chunk may hold; more than a journal ever writes into one."""

_LARGEST_RECORD = 1 << 30
_FOOTER_BYTES = 37
"""Length of the last record of a file, with the magic bytes behind it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class JournalEntry:
    """One message of a journal.

    Attributes:
        type: ``package/msg/Name``.
        sent_ns: When it was sent [ns since 1970].
        lost: Number of messages of its topic right before it that the journal found no room for.
        data: Serialised, as it was sent.
        decoder: Returns the message of ``data`` with its fields as attributes.
    """

    topic: str
    type: str
    sent_ns: int
    lost: int
    data: bytes
    decoder: Callable[[bytes], Any]

    def decode(self) -> Any:
        """Return the message with its fields as attributes.

        Raises:
            BtAgentsError: The message or the definition of its type cannot be read.
        """
        try:
            return self.decoder(self.data)
        except BtAgentsError:
            raise
        except Exception as error:
            # Whatever a decoder makes of broken bytes.
            reason = str(error) or type(error).__name__
            raise BtAgentsError(
                f"it or the definition of its type is damaged ({reason})"
            ) from None


@dataclass(frozen=True, kw_only=True, slots=True)
class StoredMessage:
    """One message of a file with all that the file says of it.

    Attributes:
        is_ours: A journal has written the file, so that sequences count the messages of a topic.
        decoder: As that of :class:`JournalEntry`.
    """

    channel: Channel
    schema: Schema
    message: Message
    is_ours: bool
    decoder: Callable[[bytes], Any]


@dataclass(kw_only=True, slots=True)
class Counted:
    """Count of the messages of one topic that were not returned.

    Attributes:
        lost: Number of those that the journal found no room for.
        first_ns: When the first one was sent [ns since 1970].
        last_ns: When the last one was.
    """

    messages: int = 0
    lost: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def add(self, sent_ns: int, lost: int) -> None:
        """Count one message."""
        self.messages += 1
        self.lost += lost
        self.first_ns = min(self.first_ns or sent_ns, sent_ns)
        self.last_ns = max(self.last_ns, sent_ns)


class JournalReader:
    """Reader of the messages of some files, in the order in which they were sent.

    Duplicates, such as a latched message that a journal received again after its restart, are
    returned once.

    Attributes:
        problems: Texts about what could not be read; complete after reading.
        counted: Topic → its messages that were only counted; complete after reading.

    Raises:
        BtAgentsError: A file cannot be opened.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.problems: list[str] = []
        self.counted: dict[str, Counted] = {}
        self._paths = paths
        for path in paths:
            try:
                with path.open("rb"):
                    pass
            except OSError as error:
                raise BtAgentsError(f"no journal {path}: {error.strerror}") from None

    def entries(self, types: Collection[str] | None = None) -> list[JournalEntry]:
        """Return messages of the types ``package/msg/Name``; None returns all.

        The others are counted as often as they are there.
        """
        seen: set[int] = set()
        found = []
        for path in self._paths:
            for entry in self._of_file(path, types):
                key = hash((entry.topic, entry.sent_ns, zlib.crc32(entry.data)))
                if key not in seen:
                    seen.add(key)
                    found.append(entry)
        return sorted(found, key=lambda entry: entry.sent_ns)

    def stored(self, path: Path) -> Iterator[StoredMessage]:
        """Yield the messages of one of the files as they are stored, duplicates too."""
        with path.open("rb") as file:
            schemas, channels = _summary(file)
            unknown = 0
            factory = DecoderFactory()
            ours = False
            for record in self._records(path, file):
                match record:
                    case Header():
                        # Others may count their messages otherwise.
                        ours = record.library == LIBRARY
                    case Schema():
                        schemas[record.id] = record
                    case Channel():
                        channels[record.id] = record
                    case Message(channel_id=number) if number in channels:
                        channel = channels[number]
                        schema = schemas.get(channel.schema_id)
                        if schema is None:
                            unknown += 1
                            continue
                        yield StoredMessage(
                            channel=channel,
                            schema=schema,
                            message=record,
                            is_ours=ours,
                            decoder=partial(_decoded, factory, channel, schema),
                        )
                    case Message():
                        unknown += 1
            if unknown:
                self.problems.append(
                    f"{path} holds {unknown} messages of which the topic cannot be read"
                )

    def _of_file(self, path: Path, types: Collection[str] | None) -> Iterator[JournalEntry]:
        sequences: dict[int, int] = {}
        for one in self.stored(path):
            lost = _lost_before(one.message, sequences) if one.is_ours else 0
            if types is not None and one.schema.name not in types:
                counted = self.counted.setdefault(one.channel.topic, Counted())
                counted.add(one.message.publish_time, lost)
                continue
            yield JournalEntry(
                topic=one.channel.topic,
                type=one.schema.name,
                sent_ns=one.message.publish_time,
                lost=lost,
                data=one.message.data,
                decoder=one.decoder,
            )

    def _records(self, path: Path, file: BinaryIO) -> Iterator[McapRecord]:
        """Yield the records of a file up to where it cannot be read any more.

        A file that ends after a whole record has lost nothing: it is being written, or its journal
        was killed.
        """
        whole = 0
        reader = StreamReader(file, emit_chunks=True, record_size_limit=_LARGEST_RECORD)
        try:
            for record in reader.records:
                whole = file.tell()
                if isinstance(record, Chunk):
                    yield from self._of_chunk(path, record)
                else:
                    yield record
        except EndOfFile:
            size = os.fstat(file.fileno()).st_size
            if size > whole:
                self.problems.append(
                    f"{path} ends in the middle of a record, as after a kill: its last "
                    f"{size - whole} bytes cannot be read"
                )
        except Exception as error:
            # Whatever a decoder makes of broken bytes.
            why = str(error) or type(error).__name__
            self.problems.append(f"{path} can be read to byte {file.tell()} only: {why}")

    def _of_chunk(self, path: Path, chunk: Chunk) -> list[McapRecord]:
        try:
            return _unpacked(chunk)
        except Exception as error:
            self.problems.append(f"{path} has a part that cannot be read: {error}")
            return []


def _lost_before(message: Message, sequences: dict[int, int]) -> int:
    """Return how many messages of the same topic are missing before one.

    Each file counts the messages of every topic from 1. In files of earlier versions, which
    several starts of a journal have written, each start counts from 1. ``sequences`` holds the
    number of the last message by channel.
    """
    before = sequences.get(message.channel_id, 0)
    sequences[message.channel_id] = message.sequence
    if message.sequence <= before:
        before = 0
    return max(message.sequence - before - 1, 0)


def _summary(file: BinaryIO) -> tuple[dict[int, Schema], dict[int, Channel]]:
    """Return the schemas and channels in the summary of a file; none when it has no summary.

    They serve where the chunk that declares them, often the first one, cannot be read.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    try:
        file.seek(-_FOOTER_BYTES, os.SEEK_END)
        footer = next(StreamReader(file, skip_magic=True).records)
        if isinstance(footer, Footer) and footer.summary_start:
            file.seek(footer.summary_start)
            summary = StreamReader(
                file, skip_magic=True, emit_chunks=True, record_size_limit=_LARGEST_RECORD
            )
            for record in summary.records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
    except Exception:
        # Whatever a decoder makes of broken bytes; the messages are read all the same.
        pass
    finally:
        file.seek(0)
    return schemas, channels


def _unpacked(chunk: Chunk) -> list[McapRecord]:
    """Return the records of a chunk; raises whatever a decoder makes of broken bytes.

    No more is unpacked than the chunk declares, and that is bounded.
    """
    size = chunk.uncompressed_size
    if size > MOST_UNPACKED:
        raise ValueError(f"it is said to hold {size} bytes, expected at most {MOST_UNPACKED}")
    match chunk.compression:
        case "zstd":
            data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
        case "":
            data = chunk.data
        case other:
            raise ValueError(f"it is compressed by {other}, expected zstd")
    if len(data) != size:
        raise ValueError(f"it holds other than the {size} bytes that it is said to")
    return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)


def _decoded(factory: DecoderFactory, channel: Channel, schema: Schema, data: bytes) -> Any:
    """Return a message of a channel; the factory makes the decoder of a schema once."""
    decoder = factory.decoder_for(channel.message_encoding, schema)
    if decoder is None:
        raise BtAgentsError(
            f"{channel.topic} is written as {channel.message_encoding} with a "
            f"{schema.encoding} schema, expected cdr with ros2msg"
        )
    return decoder(data)
