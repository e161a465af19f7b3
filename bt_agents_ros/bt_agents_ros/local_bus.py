# SPDX-License-Identifier: Apache-2.0
"""Bus of one process: messages, requests and answers between its nodes, without middleware.

An item waits in the queue of its receiver until an executor takes it, so that a sender never calls
a receiver directly. Each receiver gets its own copy.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

Copy: TypeAlias = Callable[[Any], Any]
"""Function that returns a copy, which shares no mutable data with its original."""


@dataclass(frozen=True, kw_only=True)
class Channel:
    """Properties that both ends of a topic agree on, and the queue depth of one end.

    Attributes:
        kind: Type of the messages.
        depth: Number of messages to keep, dropping the oldest; None for any number.
        is_reliable: Whether no message may be lost within the depth.
        is_latched: Whether late readers get what writers still keep.
    """

    kind: Any
    depth: int | None
    is_reliable: bool
    is_latched: bool

    def suits(self, reader: Channel) -> bool:
        """Return whether a reader on this channel matches a writer, as in DDS."""
        return (
            self.kind is reader.kind
            and self.is_reliable >= reader.is_reliable
            and self.is_latched >= reader.is_latched
        )


class LocalQueue:
    """Bounded queue of one entity's items from the bus; it drops the oldest one when full.

    Args:
        bus: The bus that lists it as pending while it is not empty.
        entity: The entity whose callback is called.
        depth: Maximum number of items; None for any number.
        part: Part of an action, as in the data of a waitable; empty otherwise.
    """

    def __init__(self, bus: LocalBus, entity: Any, depth: int | None, part: str = "") -> None:
        self.entity = entity
        self.part = part
        self._bus = bus
        self._items: deque[Any] = deque(maxlen=depth)
        self._is_closed = False

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Any) -> None:
        """Append an item; do nothing if the entity was destroyed."""
        if not self._is_closed:
            self._items.append(item)
            self._bus.pending[self] = None

    def take(self) -> Any | None:
        """Remove and return the oldest item; None if there is none.

        If items remain, the queue moves to the end of the pending queues.
        """
        self._bus.pending.pop(self, None)
        item = self._items.popleft() if self._items else None
        if self._items:
            self._bus.pending[self] = None
        return item

    def close(self) -> None:
        """Drop all items, also those that arrive later."""
        self._is_closed = True
        self._items.clear()
        self._bus.pending.pop(self, None)


@dataclass(eq=False)
class LocalReader:
    """Subscription on a topic of the bus.

    Attributes:
        copy: Makes this reader's copy of a message; None for a full copy.
    """

    topic: str
    channel: Channel
    queue: LocalQueue
    copy: Copy | None = None


@dataclass(eq=False)
class LocalWriter:
    """Publisher on a topic of the bus.

    Attributes:
        kept: The last messages of a latched topic, for late readers.
    """

    topic: str
    channel: Channel
    copy: Copy
    kept: deque[LocalMessage] = field(init=False)

    def __post_init__(self) -> None:
        self.kept = deque(maxlen=self.channel.depth)


@dataclass(eq=False)
class LocalServer:
    """Service of the bus."""

    name: str
    kind: Any
    queue: LocalQueue


@dataclass(frozen=True, slots=True)
class LocalMessage:
    """Message in the queue of a subscription.

    Attributes:
        message: A copy that belongs to the receiver.
        stamp_ns: Time of publication [ns].
    """

    message: Any
    stamp_ns: int


@dataclass(frozen=True, kw_only=True)
class LocalRequest:
    """Request in the queue of a service.

    Attributes:
        request: A copy of the sent request.
        answer: Passes a response to the client; called at most once.
    """

    request: Any
    answer: Callable[[Any], None]


class LocalBus:
    """Topics and services of the nodes of one process; use it from its executor's thread.

    Args:
        clock_ns: Returns the time of the day [ns].

    Attributes:
        pending: The queues that are not empty, the one that waits longest first.
        outgoing: Ordered publications for other processes, which are written after the nodes of
            this process have received theirs.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self.pending: dict[LocalQueue, None] = {}
        self.outgoing: dict[object, Callable[[], None]] = {}
        self._readers: dict[str, list[LocalReader]] = {}
        self._writers: dict[str, list[LocalWriter]] = {}
        self._servers: dict[str, list[LocalServer]] = {}
        self._number = 0

    def add_writer(self, topic: str, channel: Channel, copy: Copy) -> LocalWriter:
        """Return a new publisher of a topic."""
        writer = LocalWriter(topic, channel, copy)
        self._writers.setdefault(topic, []).append(writer)
        return writer

    def add_reader(
        self, topic: str, channel: Channel, queue: LocalQueue, copy: Copy | None = None
    ) -> LocalReader:
        """Return a new subscription; a latched one receives the kept messages at once."""
        reader = LocalReader(topic, channel, queue, copy)
        self._readers.setdefault(topic, []).append(reader)
        if channel.is_latched:
            for writer in self.writers_of(reader):
                for kept in writer.kept:
                    _put(writer, reader, kept)
        return reader

    def add_server(self, name: str, kind: Any, queue: LocalQueue) -> LocalServer:
        """Return a new service."""
        server = LocalServer(name, kind, queue)
        self._servers.setdefault(name, []).append(server)
        return server

    def remove(self, end: LocalReader | LocalWriter | LocalServer) -> None:
        """Remove a destroyed entity, with the messages that a publisher kept."""
        match end:
            case LocalWriter():
                self._writers[end.topic].remove(end)
                return
            case LocalReader():
                self._readers[end.topic].remove(end)
            case LocalServer():
                self._servers[end.name].remove(end)
        end.queue.close()

    def readers_of(self, writer: LocalWriter) -> list[LocalReader]:
        """Return the subscriptions that get the messages of a publisher."""
        readers = self._readers.get(writer.topic, ())
        return [one for one in readers if writer.channel.suits(one.channel)]

    def writers_of(self, reader: LocalReader) -> list[LocalWriter]:
        """Return the publishers whose messages a subscription gets."""
        writers = self._writers.get(reader.topic, ())
        return [one for one in writers if one.channel.suits(reader.channel)]

    def publish(self, writer: LocalWriter, message: Any, *, is_kept: bool = False) -> None:
        """Pass a copy of a message to each subscription, and keep a copy if the topic is latched.

        With ``is_kept``, the caller never changes the message again, and the bus keeps it itself.
        """
        published = LocalMessage(message, self._clock_ns())
        for reader in self.readers_of(writer):
            _put(writer, reader, published)
        if writer.channel.is_latched:
            kept = message if is_kept else writer.copy(message)
            writer.kept.append(LocalMessage(kept, published.stamp_ns))

    def server_of(self, name: str, kind: Any) -> LocalServer | None:
        """Return the service with a name and a type in this process, the oldest of several."""
        for server in self._servers.get(name, ()):
            if server.kind is kind:
                return server
        return None

    def call(self, server: LocalServer, request: Any, answer: Callable[[int, Any], None]) -> int:
        """Pass a request to a service; the caller gives it up.

        Args:
            server: From :meth:`server_of`.
            request: Not copied.
            answer: Takes the number of the request and the response.

        Returns:
            The number; no request over the middleware has it.
        """
        self._number -= 1
        number = self._number
        local = LocalRequest(request=request, answer=lambda response: answer(number, response))
        server.queue.put(local)
        return number

    def send_out(self, write: Callable[[], None], state_of: object | None = None) -> None:
        """Schedule a publication for other processes.

        Args:
            write: Writes it.
            state_of: The object whose newest state it is; an older unwritten state is dropped,
                because a publisher of depth 1 keeps only one.
        """
        key = object() if state_of is None else state_of
        self.outgoing.pop(key, None)
        self.outgoing[key] = write

    def write_next(self) -> None:
        """Write the oldest publication for other processes, if there is one."""
        if self.outgoing:
            self.outgoing.pop(next(iter(self.outgoing)))()

    def write_out(self) -> None:
        """Write all publications for other processes now."""
        while self.outgoing:
            self.write_next()


def _put(writer: LocalWriter, reader: LocalReader, published: LocalMessage) -> None:
    copy = reader.copy or writer.copy
    reader.queue.put(LocalMessage(copy(published.message), published.stamp_ns))
