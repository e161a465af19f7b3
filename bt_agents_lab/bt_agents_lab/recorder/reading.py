# SPDX-License-Identifier: Apache-2.0
"""Reader of journals and ``ros2 bag record`` bags, whole or torn, without ROS."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from io import BytesIO
from itertools import islice
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO

import zstandard
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Header, McapRecord, Message, Schema
from mcap.stream_reader import MAGIC_SIZE, StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from mcap_ros2.decoder import DecoderFactory

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import join_first
from bt_agents_lab.recorder.bag import COMPRESSED, RecordedFiles, recorded_files
from bt_agents_lab.recorder.file import LIBRARY, PROGRAM
from bt_agents_ros.system_topics import HOST, TOPICS

MOST_UNPACKED = 1 << 26
"""Most bytes of a chunk; more than a journal ever writes into one."""

MOST_UNPACKED_FILE = 1 << 31
"""Most bytes to read from a file that is compressed as a whole."""

MOST_FURTHER = 5000
"""Maximum number of messages of any type to read at once from a file that is read in pieces."""

_SETBACK_NS = 10**9
_LARGEST_RECORD = 1 << 30
_FIRST_MESSAGES = 1000
_HEAD = Struct("<BQ")
"""Opcode and length [bytes] before each record."""

_RECORDS = frozenset((Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK))
_OWN_PACKAGE = "bt_agents_interfaces/"
_TELLING = tuple(
    one for one in TOPICS if one.type.startswith(_OWN_PACKAGE) and HOST not in one.name
)
"""Topics whose names and types identify a system."""

_FOOTER_BYTES = 37
"""Length of the last record of a file, including the magic bytes after it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class JournalEntry:
    """Message of a journal.

    Attributes:
        type: ``package/msg/Name``.
        sent_ns: When it was sent, or for a bag without that time, received [ns since 1970].
        turn: How often the clock of a journal was set back before, and ``sent_ns``, or when it was
            received, if that was earlier; orders all entries.
        lost: Number of messages of its topic that the journal dropped right before it.
        data: Serialized message, as it was sent.
        decoder: Returns the message of ``data`` with its fields as attributes.
    """

    topic: str
    type: str
    sent_ns: int
    turn: tuple[int, int]
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
            # Decoders raise any exception for broken bytes.
            reason = str(error) or type(error).__name__
            raise BtAgentsError(
                f"it or the definition of its type is damaged ({reason})"
            ) from None


@dataclass(frozen=True, kw_only=True, slots=True)
class StoredMessage:
    """Message of a file with all that the file states about it.

    Attributes:
        is_ours: Whether a journal wrote the file, so that sequences count a topic's messages.
        decoder: As in :class:`JournalEntry`.
    """

    channel: Channel
    schema: Schema
    message: Message
    is_ours: bool
    decoder: Callable[[bytes], Any]


@dataclass(kw_only=True, slots=True)
class Counted:
    """Count of the messages of one topic that are not returned.

    Attributes:
        lost: Number of messages that the journal dropped.
        first_ns: When the first message was sent [ns since 1970].
        last_ns: When the last message was sent [ns since 1970].
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


@dataclass(kw_only=True, slots=True)
class _Position:
    """How far a file has been read, and what its records up to there declare.

    Attributes:
        whole: End of the last record that was complete [bytes].
        sequences: Number of the last message by channel.
        received_ns: When the last message was received [ns since 1970].
    """

    whole: int = 0
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    factory: DecoderFactory = field(default_factory=DecoderFactory)
    is_ours: bool = False
    sequences: dict[int, int] = field(default_factory=dict)
    received_ns: int = 0


class JournalReader:
    """Reader of the messages of some journals and bags, in the order of sending.

    Messages from before and after a moment when the clock of a journal was set back stay apart.

    Duplicates, such as a latched message that a journal received again after its restart, are
    returned once.

    Args:
        paths: Files, bags, or folders of files.
        namespace: Namespace of the system to read, if there are several.

    Attributes:
        files: All files that are read.
        problems: Texts about unreadable parts; complete after reading.
        hints: Texts about information that the files lack; complete after reading.
        is_counted: Whether the files count lost messages; complete after reading.
        counted: Topic → count of its messages that are not returned; complete after reading.
        is_at_end: Whether :meth:`further_entries` has returned everything in the files.

    Raises:
        Refused: ``SQLITE_BAG`` or ``NO_RECORDING``.
        BtAgentsError: A file cannot be opened.
    """

    def __init__(self, paths: Sequence[Path], namespace: str = "") -> None:
        self.problems: list[str] = []
        self.hints: list[str] = []
        self.is_counted = True
        self.counted: dict[str, Counted] = {}
        self._namespace = f"/{namespace.strip('/')}"
        self.files: list[Path] = []
        self._recorded: dict[Path, RecordedFiles] = {}
        self._positions: dict[Path, _Position] = {}
        self._setbacks = 0
        self._further: Iterator[JournalEntry] | None = None
        self.is_at_end = False
        self._seen: set[int] = set()
        self._namespaces: set[str] = set()
        for path in paths:
            try:
                self._recorded[path] = recorded_files(path)
                for file in self._recorded[path].paths:
                    with file.open("rb"):
                        self.files.append(file)
            except OSError as error:
                raise BtAgentsError(
                    f"no journal {error.filename or path}: {error.strerror}"
                ) from None

    def entries(self, types: Collection[str] | None = None) -> list[JournalEntry]:
        """Return messages of the types ``package/msg/Name``; None returns all.

        Each occurrence of the others is counted.

        Raises:
            Refused: ``OTHER_FORMAT``, or ``SEVERAL_SYSTEMS``: several were recorded together, and
                none is in the namespace.
        """
        self._positions.clear()
        self._seen.clear()
        self._namespaces.clear()
        self._further = None
        return self._of_system([one for one in self._unread() if self._is_new(one, types)])

    def further_entries(self, types: Collection[str] | None = None) -> list[JournalEntry]:
        """Return the entries among the next :data:`MOST_FURTHER` messages after the last call.

        A message that was sent before those of the last call, and written after them, is among
        the further ones. The first system counts as the only one until another one has a message.

        Raises:
            Refused: As in :meth:`entries`.
        """
        if self._further is None:
            self._further = self._unread()
        found = list(islice(self._further, MOST_FURTHER))
        self.is_at_end = len(found) < MOST_FURTHER
        if self.is_at_end:
            self._further = None
        return self._of_system([one for one in found if self._is_new(one, types)])

    def _unread(self) -> Iterator[JournalEntry]:
        """Yield all messages since the last call, as written."""
        for path, recorded in self._recorded.items():
            self.problems += recorded.problems
            number = 0
            for file in recorded.paths:
                for one in self._of_file(file):
                    number += 1
                    yield one
            if number < (recorded.messages or 0):
                self.problems.append(
                    f"{path} is said to hold {recorded.messages} messages, found {number}"
                )

    def _is_new(self, one: JournalEntry, types: Collection[str] | None) -> bool:
        """Return whether a message is of the types and no duplicate; count one of other types."""
        if types is not None and one.type not in types:
            self._count(one)
            return False
        key = hash((one.topic, one.sent_ns, zlib.crc32(one.data)))
        if key in self._seen:
            return False
        self._seen.add(key)
        return True

    def stored(self, path: Path) -> Iterator[StoredMessage]:
        """Yield the messages of one of the files as stored, including duplicates.

        Raises:
            Refused: ``OTHER_FORMAT``.
        """
        return self._stored(path, _Position())

    def _stored(self, path: Path, at: _Position) -> Iterator[StoredMessage]:
        """Yield the messages of a file after a position, which moves on."""
        with path.open("rb") as file:
            if not at.whole and not _is_packed(path):
                at.schemas, at.channels = _summary(file)
            unknown = 0
            for record in self._records(path, file, at):
                match record:
                    case Header():
                        # Other programs may count messages differently.
                        at.is_ours = record.library == LIBRARY
                        if not at.is_ours:
                            self._note_foreign(path, record.library)
                    case Schema():
                        at.schemas[record.id] = record
                    case Channel():
                        at.channels[record.id] = record
                    case Message(channel_id=number) if number in at.channels:
                        channel = at.channels[number]
                        schema = at.schemas.get(channel.schema_id)
                        if schema is None:
                            unknown += 1
                            continue
                        yield StoredMessage(
                            channel=channel,
                            schema=schema,
                            message=record,
                            is_ours=at.is_ours,
                            decoder=partial(_decoded, at.factory, channel, schema),
                        )
                    case Message():
                        unknown += 1
            if unknown:
                self.problems.append(f"{path} holds {unknown} messages of unreadable topics")

    def _of_file(self, path: Path) -> Iterator[JournalEntry]:
        at = self._positions.setdefault(path, _Position())
        for one in self._stored(path, at):
            received_ns = one.message.log_time
            # Recorders that do not know the time of sending write 0.
            sent_ns = one.message.publish_time or received_ns
            # Only a journal is known to write messages as it receives them.
            self._setbacks += one.is_ours and received_ns < at.received_ns - _SETBACK_NS
            at.received_ns = received_ns
            yield JournalEntry(
                topic=one.channel.topic,
                type=one.schema.name,
                sent_ns=sent_ns,
                turn=(self._setbacks, min(sent_ns, received_ns) if one.is_ours else sent_ns),
                lost=lost_before(one.message, at.sequences) if one.is_ours else 0,
                data=one.message.data,
                decoder=one.decoder,
            )

    def _count(self, one: JournalEntry) -> None:
        self.counted.setdefault(one.topic, Counted()).add(one.sent_ns, one.lost)

    def _note_foreign(self, path: Path, library: str) -> None:
        """Note once that another program wrote a file.

        Raises:
            Refused: ``OTHER_FORMAT``; another version of this program wrote it.
        """
        if library.startswith(PROGRAM):
            raise Refused(
                RefusalCode.OTHER_FORMAT,
                f"{path} is a journal of the format {library[:40]!a}, this version reads "
                f"'{LIBRARY}'; read it with the version that recorded it, or move it away",
            )
        if self.is_counted:
            self.hints.append(
                f"{path} was written by {library or 'another program'}: it does not tell which "
                "messages its recorder has missed"
            )
        self.is_counted = False

    def _of_system(self, entries: list[JournalEntry]) -> list[JournalEntry]:
        """Return the messages of the system in the namespace, or of the only one, sorted.

        Each of the others is counted.
        """
        entries.sort(key=lambda entry: entry.turn)
        topics = {(one.topic, one.type) for one in entries}
        self._namespaces |= {_namespace_of(*topic) for topic in topics} - {""}
        namespaces = self._namespaces
        if len(namespaces) < 2:
            return entries
        names = join_first(sorted(namespaces))
        if self._namespace not in namespaces:
            raise Refused(
                RefusalCode.SEVERAL_SYSTEMS,
                f"the systems of the namespaces {names} were recorded together, expected one in "
                f"{self._namespace}; set ROS_NAMESPACE to the one to read",
            )
        hint = (
            f"of the systems of the namespaces {names}, this is the one in {self._namespace}; "
            "ROS_NAMESPACE chooses"
        )
        if hint not in self.hints:
            self.hints.append(hint)
        roots = sorted(namespaces, key=len, reverse=True)
        ours = []
        for one in entries:
            below = (root for root in roots if one.topic.startswith(f"{root.rstrip('/')}/"))
            if next(below, self._namespace) == self._namespace:
                ours.append(one)
            else:
                self._count(one)
        return ours

    def _records(self, path: Path, file: BinaryIO, at: _Position) -> Iterator[McapRecord]:
        """Yield the records of a file after a position, up to its first unreadable part.

        A file that ends after a complete record has lost nothing: it is being written, or its
        journal was killed.
        """
        is_packed = _is_packed(path)
        if not is_packed:
            file.seek(at.whole)
        reader = StreamReader(
            file, skip_magic=bool(at.whole), emit_chunks=True, record_size_limit=_LARGEST_RECORD
        )
        try:
            for record in _unpacked_records(file) if is_packed else reader.records:
                at.whole = file.tell()
                if isinstance(record, Chunk):
                    yield from self._of_chunk(path, record)
                else:
                    yield record
        except EndOfFile:
            size = os.fstat(file.fileno()).st_size
            if is_packed:
                # The file was compressed after its end was written.
                self.problems.append(f"{path} is torn: the end of what was packed is missing")
            elif size > at.whole:
                self.problems.append(
                    f"{path} ends in the middle of a record, as after a kill: its last "
                    f"{size - at.whole} bytes cannot be read"
                )
        except Exception as error:
            # Decoders raise any exception for broken bytes.
            why = str(error) or type(error).__name__
            self.problems.append(f"{path} can be read to byte {file.tell()} only: {why}")

    def _of_chunk(self, path: Path, chunk: Chunk) -> list[McapRecord]:
        try:
            return _unpacked(chunk)
        except Exception as error:
            self.problems.append(f"{path} has a part that cannot be read: {error}")
            return []


def _unpacked_records(file: BinaryIO) -> Iterator[McapRecord]:
    """Yield the records of a file that is compressed as a whole, one by one, up to its end.

    They are unpacked one after the other.

    Raises:
        EndOfFile: It is torn.
        ValueError: It holds more than :data:`MOST_UNPACKED_FILE`, or is not MCAP.
        Exception: Any exception of a decoder for broken bytes.
    """
    unpacked = zstandard.ZstdDecompressor(max_window_size=MOST_UNPACKED).stream_reader(file)
    if unpacked.read(MAGIC_SIZE) != MCAP0_MAGIC:
        raise ValueError("its content is not MCAP")
    left = MOST_UNPACKED_FILE
    while len(head := unpacked.read(_HEAD.size)) == _HEAD.size:
        number, length = _HEAD.unpack(head)
        left -= _HEAD.size + length
        if left < 0 or length > MOST_UNPACKED:
            raise ValueError(
                f"it holds more than {MOST_UNPACKED_FILE} bytes, or more than {MOST_UNPACKED} at "
                "once; unpack it with 'zstd -d' and read that"
            )
        body = unpacked.read(length)
        if len(body) < length:
            break
        if number == Opcode.DATA_END:
            return
        if number in _RECORDS:
            reader = StreamReader(BytesIO(head + body), skip_magic=True, emit_chunks=True)
            yield next(reader.records)
    raise EndOfFile


def _is_packed(path: Path) -> bool:
    return path.name.endswith(COMPRESSED)


def _namespace_of(topic: str, type_name: str) -> str:
    """Return the namespace of a topic's system; empty if the topic does not show it."""
    full = f"/{topic.lstrip('/')}"
    for known in _TELLING:
        if known.type == type_name and full.endswith(f"/{known.name}"):
            return full.removesuffix(f"/{known.name}") or "/"
    return ""


def lost_before(message: Message, sequences: dict[int, int]) -> int:
    """Return the number of missing messages of the same topic before a message.

    Each file counts the messages of every topic from 1. ``sequences`` holds the number of the
    last message by channel.
    """
    before = sequences.get(message.channel_id, 0)
    sequences[message.channel_id] = message.sequence
    return max(message.sequence - before - 1, 0)


def _summary(file: BinaryIO) -> tuple[dict[int, Schema], dict[int, Channel]]:
    """Return the schemas and channels in the summary of a file; none if it has no summary.

    They help if the chunk that declares them, often the first one, is unreadable.
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
        # Decoders raise any exception for broken bytes; the messages are still read.
        pass
    finally:
        file.seek(0)
    return schemas, channels


def _unpacked(chunk: Chunk) -> list[McapRecord]:
    """Return the records of a chunk; raises any exception of a decoder for broken bytes.

    It unpacks no more than the chunk declares, and that is bounded.
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
    """Return a message of a channel; the factory makes each schema's decoder once."""
    decoder = factory.decoder_for(channel.message_encoding, schema)
    if decoder is None and not schema.data:
        raise BtAgentsError(
            f"its recorder has not found the definition of {schema.name}; start 'ros2 bag record' "
            "where the packages of the system are installed"
        )
    if decoder is None:
        raise BtAgentsError(
            f"{channel.topic} is written as {channel.message_encoding} with a "
            f"{schema.encoding} schema, expected cdr with ros2msg"
        )
    return decoder(data)


def recording_label(path: Path) -> str:
    """Return the label of a file's start; empty for none.

    It directly follows the facts at the beginning of a file, so no more is read.
    """
    try:
        reader = JournalReader([path])
        for one in islice(reader.stored(reader.files[0]), _FIRST_MESSAGES):
            if one.schema.name == "bt_agents_interfaces/msg/RecordingStatus":
                return str(one.decoder(one.message.data).label)
    except Exception:
        # Decoders raise any exception for broken bytes.
        pass
    return ""
