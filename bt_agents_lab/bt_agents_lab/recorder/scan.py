# SPDX-License-Identifier: Apache-2.0
"""Looks what a file of the journal holds and where its last whole record ends."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import BinaryIO, cast

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, MessageIndex, Schema
from mcap.writer import MCAP0_MAGIC

from bt_agents_lab.recorder.mcap_format import (
    HEAD_BYTES,
    Contents,
    head,
    indexes_of,
    packed,
    unpacked,
)

_KNOWN = frozenset(Opcode)


@dataclass(kw_only=True)
class Survey:
    """What a file holds.

    Attributes:
        contents: What can be read.
        end: Where the last whole record with messages ends; 0 when it is no file of this kind.
        whole: Whether nothing but the summary follows.
        missing: What has to be written there first: the indexes of the last chunk.
    """

    contents: Contents = field(default_factory=Contents)
    end: int = 0
    whole: bool = True
    missing: bytes = b""


def survey(file: BinaryIO) -> Survey:
    """Return what a file holds, however it ends."""
    found = Survey()
    file.seek(0, 2)
    size = file.tell()
    file.seek(0)
    if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        found.whole = size == 0
        return found
    found.end = len(MCAP0_MAGIC)
    walk = _Walk(found)
    while True:
        front = file.read(HEAD_BYTES)
        opcode, length = front[0] if front else 0, int.from_bytes(front[1:], "little")
        if len(front) < HEAD_BYTES or opcode not in _KNOWN or found.end + length > size:
            found.whole = not front and found.end == size
            break
        if opcode == Opcode.DATA_END:
            break
        data = file.read(length)
        if len(data) < length or not walk.take(Opcode(opcode), data):
            found.whole = False
            break
        found.end += HEAD_BYTES + length
    walk.finish()
    if found.end < len(head()):
        # Not even its header is whole.
        found.end = 0
    return found


class _Walk:
    """Takes the records of a file in order."""

    def __init__(self, found: Survey) -> None:
        self._found = found
        self._chunk: Chunk | None = None
        self._at = 0
        self._length = 0
        self._indexes: list[MessageIndex] = []

    def take(self, opcode: Opcode, data: bytes) -> bool:
        """Take a record; return False when it cannot be read."""
        contents = self._found.contents
        try:
            match opcode:
                case Opcode.SCHEMA:
                    schema = cast(Schema, unpacked(data, Schema))
                    contents.schemas[schema.id] = schema
                case Opcode.CHANNEL:
                    channel = cast(Channel, unpacked(data, Channel))
                    contents.channels[channel.id] = channel
                case Opcode.MESSAGE_INDEX:
                    self._indexes.append(cast(MessageIndex, unpacked(data, MessageIndex)))
                case Opcode.CHUNK:
                    self._note_chunk()
                    self._chunk = cast(Chunk, unpacked(data, Chunk))
                    self._at, self._length = self._found.end, HEAD_BYTES + len(data)
        except Exception:
            # Whatever a decoder makes of broken bytes.
            return False
        return True

    def finish(self) -> None:
        """Note the last chunk, whose indexes may be torn off and are made anew."""
        if self._chunk is None:
            return
        try:
            self._indexes = indexes_of(self._chunk)
        except Exception:
            self._found.end, self._found.whole = self._at, False
            return
        self._found.end = self._at + self._length
        self._found.missing = packed(*self._indexes)
        self._note_chunk()

    def _note_chunk(self) -> None:
        if self._chunk is not None:
            self._found.contents.note(self._chunk, self._length, self._at, self._indexes)
        self._chunk, self._indexes = None, []
