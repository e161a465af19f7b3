# SPDX-License-Identifier: Apache-2.0
"""The parts of an MCAP file that is only ever added to, as bytes and back.

Format: https://mcap.dev/spec. Schemas and channels stand outside of chunks, so that they can be
found without unpacking anything; the indexes of a chunk follow it.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

LIBRARY = "bt-agents"
"""Who has written a file, as its header says."""

HEAD_BYTES = 9
"""Opcode and length in front of every record."""


MOST_UNPACKED = 1 << 26
"""Bytes that a chunk may hold; more than one flush ever writes."""


@dataclass(kw_only=True)
class Contents:
    """What a file holds so far, as its summary tells it.

    Attributes:
        schemas: By id.
        channels: By id.
        chunks: Where the chunks are, in order.
        counts: Id of a channel → messages on it.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)

    def note(self, chunk: Chunk, length: int, at: int, indexes: Iterable[MessageIndex]) -> None:
        """Note a chunk, which is followed by the indexes of its messages.

        Args:
            chunk: The chunk.
            length: Of its record [bytes].
            at: Where it begins in the file.
            indexes: Those of its messages.
        """
        offsets = {}
        here = at + length
        for index in indexes:
            offsets[index.channel_id] = here
            here += len(packed(index))
            known = self.counts.get(index.channel_id, 0)
            self.counts[index.channel_id] = known + len(index.records)
        self.chunks.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=at,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=here - at - length,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )


def head() -> bytes:
    """Return how a file begins."""
    return MCAP0_MAGIC + packed(Header(profile="ros2", library=LIBRARY))


def packed(*records: McapRecord) -> bytes:
    """Return records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return _bytes(builder)


def _bytes(builder: RecordBuilder) -> bytes:
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def chunk_of(messages: Iterable[Message]) -> tuple[Chunk, list[MessageIndex]]:
    """Return messages as one chunk, with where in it they are."""
    builder = RecordBuilder()
    indexes: dict[int, MessageIndex] = {}
    times = []
    for message in messages:
        index = indexes.setdefault(
            message.channel_id, MessageIndex(channel_id=message.channel_id, records=[])
        )
        index.records.append((message.log_time, builder.count))
        times.append(message.log_time)
        message.write(builder)
    data = _bytes(builder)
    chunk = Chunk(
        compression="zstd",
        data=zstandard.compress(data),
        message_start_time=min(times),
        message_end_time=max(times),
        uncompressed_crc=zlib.crc32(data),
        uncompressed_size=len(data),
    )
    return chunk, list(indexes.values())


def records_of(chunk: Chunk) -> list[McapRecord]:
    """Return what is in a chunk; raises whatever a decoder makes of broken bytes.

    No more is unpacked than the chunk says that it holds, and that is bounded.
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


def indexes_of(chunk: Chunk) -> list[MessageIndex]:
    """Return where in a chunk its messages are; raises what unpacking it raises."""
    messages = [one for one in records_of(chunk) if isinstance(one, Message)]
    return chunk_of(messages)[1] if messages else []


def tail(contents: Contents, at: int) -> bytes:
    """Return how a file ends: the summary by which readers find everything.

    Args:
        contents: What the file holds.
        at: Where its messages end.
    """
    end = packed(DataEnd(data_section_crc=0))
    start = at + len(end)
    groups = (
        (Opcode.SCHEMA, packed(*contents.schemas.values())),
        (Opcode.CHANNEL, packed(*contents.channels.values())),
        (Opcode.STATISTICS, packed(_statistics(contents))),
        (Opcode.CHUNK_INDEX, packed(*contents.chunks)),
    )
    summary, offsets = b"", b""
    for opcode, group in groups:
        if group:
            offsets += packed(
                SummaryOffset(
                    group_opcode=opcode,
                    group_start=start + len(summary),
                    group_length=len(group),
                )
            )
        summary += group
    offsets_at = start + len(summary)
    footer = packed(Footer(summary_start=start, summary_offset_start=offsets_at, summary_crc=0))
    # The sum covers the footer up to itself.
    crc = zlib.crc32(footer[:-4], zlib.crc32(summary + offsets))
    return end + summary + offsets + footer[:-4] + crc.to_bytes(4, "little") + MCAP0_MAGIC


def _statistics(contents: Contents) -> Statistics:
    return Statistics(
        message_count=sum(contents.counts.values()),
        schema_count=len(contents.schemas),
        channel_count=len(contents.channels),
        attachment_count=0,
        metadata_count=0,
        chunk_count=len(contents.chunks),
        message_start_time=min((one.message_start_time for one in contents.chunks), default=0),
        message_end_time=max((one.message_end_time for one in contents.chunks), default=0),
        channel_message_counts=contents.counts,
    )


def unpacked(data: bytes, kind: type[McapRecord]) -> McapRecord:
    """Return a record from its content, without the opcode and length in front of it."""
    record: McapRecord = kind.read(ReadDataStream(BytesIO(data)))  # type: ignore[attr-defined]
    return record
