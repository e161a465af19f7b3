# SPDX-License-Identifier: Apache-2.0
"""Excerpt of a journal or a bag: the messages of a span, after the facts at its beginning."""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path
from typing import BinaryIO

from mcap.writer import Writer

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_lab.recorder.facts import fact_key
from bt_agents_lab.recorder.file import LIBRARY
from bt_agents_lab.recorder.reading import JournalReader, StoredMessage, lost_before

MOST_BYTES = 128 * 1024 * 1024
"""Most bytes of the messages of an excerpt."""

_RECORD_BYTES = 31
"""Bytes of a message in a file, in addition to its data."""


def write_excerpt(
    reader: JournalReader, path: Path, from_ns: int, to_ns: int, most_bytes: int = MOST_BYTES
) -> None:
    """Write the messages that were sent in a span [ns since 1970] into a new MCAP file.

    The file begins with the facts at the beginning of the span, as each file of a journal does.
    Its numbers have the gaps of lost messages, so that its readers count them.

    Raises:
        Refused: ``OTHER_FORMAT``, ``OUT_OF_RANGE`` (the span has no message) or ``TOO_LARGE``.
        OSError: The file exists or cannot be written.
    """
    with path.open("xb") as file:
        excerpt = _Excerpt(file, from_ns, most_bytes)
        for source in reader.files:
            numbers: dict[int, int] = {}
            for one in reader.stored(source):
                lost = lost_before(one.message, numbers) if one.is_ours else 0
                sent_ns = one.message.publish_time or one.message.log_time
                if sent_ns < from_ns:
                    excerpt.take_earlier(one)
                elif sent_ns <= to_ns:
                    excerpt.add(one, lost)
        if not excerpt.is_begun:
            names = ", ".join(one.name for one in reader.files)
            raise Refused(
                RefusalCode.OUT_OF_RANGE,
                "; ".join([f"{names} has no message in the chosen span", *reader.problems]),
            )
        excerpt.close()


class _Excerpt:
    """File of an excerpt.

    Attributes:
        is_begun: Whether it has a message of the span.
    """

    def __init__(self, file: BinaryIO, from_ns: int, most_bytes: int) -> None:
        self.is_begun = False
        self._writer = Writer(file)
        self._from_ns = from_ns
        self._most_bytes = most_bytes
        self._bytes = 0
        self._facts: dict[str, StoredMessage] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[tuple[str, str, int], int] = {}
        self._numbers: Counter[str] = Counter()

    def take_earlier(self, one: StoredMessage) -> None:
        """Take a message of before the span, which is part of it if it is the last of a fact."""
        key = fact_key(one.channel.topic, one.schema.name, partial(one.decoder, one.message.data))
        if not key:
            return
        if self.is_begun:
            # It was received after messages that were sent later.
            self.add(one)
            return
        before = self._facts.pop(key, None)
        self._count(len(one.message.data) - (len(before.message.data) if before else 0))
        self._facts[key] = one

    def add(self, one: StoredMessage, lost: int = 0) -> None:
        """Write a message, before which the journal has lost some others of its topic."""
        if not self.is_begun:
            self.is_begun = True
            # Readers trust the numbers of a journal only.
            self._writer.start(profile="ros2", library=LIBRARY if one.is_ours else "")
            for fact in self._facts.values():
                self._write(fact, self._from_ns)
        self._count(_RECORD_BYTES + len(one.message.data))
        self._numbers[one.channel.topic] += lost
        self._write(one, one.message.log_time)

    def close(self) -> None:
        """Write the index, which other programs need."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _write(self, one: StoredMessage, received_ns: int) -> None:
        topic = one.channel.topic
        self._numbers[topic] += 1
        self._writer.add_message(
            channel_id=self._channel(one),
            log_time=received_ns,
            data=one.message.data,
            publish_time=one.message.publish_time,
            sequence=self._numbers[topic] % 2**32,
        )

    def _channel(self, one: StoredMessage) -> int:
        channel, schema = one.channel, one.schema
        described = (schema.name, schema.encoding, schema.data)
        if described not in self._schemas:
            self._schemas[described] = self._writer.register_schema(*described)
        number = self._schemas[described]
        key = (channel.topic, channel.message_encoding, number)
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(*key, channel.metadata)
        return self._channels[key]

    def _count(self, size: int) -> None:
        self._bytes += size
        if self._bytes > self._most_bytes:
            raise Refused(
                RefusalCode.TOO_LARGE,
                f"the chosen span has more than {self._most_bytes} bytes; choose a shorter one",
            )
