# SPDX-License-Identifier: Apache-2.0
"""Journal files and bags as recordings; each is read incrementally."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.optional_packages import journal_needs
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_studio.history import History
from bt_agents_studio.projection import Projection, is_in_use
from bt_agents_studio.protocol import Events, Moment, Snapshot
from bt_agents_studio.records import MOST_ENTRIES, BookmarkRecord, EventRecord
from bt_agents_studio.store import Change, Store

if TYPE_CHECKING:
    from bt_agents_lab.recorder.reading import JournalReader

MOST_HELD = 2
"""Maximum number of recordings in memory."""

_MOST_EVENTS = 10_000
"""Maximum number of events of a recording; the oldest are dropped first."""

_LARGEST = 512 * 1024 * 1024
_MOST_BYTES = 256 * 1024 * 1024
WRITTEN_S = 1.2
"""Time after which the journal has written a message; it writes once a second [s]."""

_LOOK_S = 0.05
_ROUNDED_NS = 1000
"""Rounding error of seconds since 1970 as a float [ns]."""


class Recordings:
    """Moments of recordings; the most recently used recordings stay in memory.

    Args:
        mood: The scene parameter that is the mood; empty for none.
        namespace: Namespace of the system, for bags of several systems.
        sleep: Waits [s].
    """

    def __init__(
        self, mood: str, namespace: str = "", sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._mood = mood
        self._namespace = namespace
        self._sleep = sleep
        self._held: OrderedDict[Path, _Recording] = OrderedDict()

    def moment(self, file: Path, at_s: float, *, waits: bool = False) -> Moment:
        """Return the entries of a journal file or a bag at a moment [s since 1970].

        Each call reads at most some thousand messages. Until ``is_whole``, the recording seems to
        end with the last of them.

        Args:
            file: Its path.
            at_s: The moment.
            waits: Whether to wait until the journal has written all messages received so far.

        Raises:
            Refused: ``NO_JOURNAL``, ``TOO_LARGE`` or ``UNREADABLE``.
        """
        recording = self._read(file, waits=waits)
        return moment_of(
            recording.store, recording.history, at_s, file.name, is_whole=recording.is_whole
        )

    def events(self, file: Path) -> Events:
        """Return the timeline of a journal file or a bag; reads as :meth:`moment` does.

        Raises:
            Refused: As in :meth:`moment`.
        """
        recording = self._read(file)
        events = recording.store.values("events", EventRecord)
        return Events(events=events, is_whole=recording.is_whole)

    def write_excerpt(
        self, file: Path, from_s: float, to_s: float, into: Path, *, waits: bool = False
    ) -> None:
        """Write the messages of a span [s since 1970] of a journal file or a bag into a new file.

        Args:
            file: Its path.
            from_s: First moment of the span.
            to_s: Last moment of the span.
            into: Path of the new file.
            waits: As in :meth:`moment`.

        Raises:
            Refused: ``UNREADABLE``, ``CANNOT_WRITE``, or as :func:`write_excerpt` does.
        """
        try:
            if waits:
                self._wait_until_written(file)
            reader = _reader(file, self._namespace)
            from bt_agents_lab.recorder.excerpt import write_excerpt

            from_ns, to_ns = round(from_s * 1e9), round(to_s * 1e9)
            write_excerpt(reader, into, from_ns - _ROUNDED_NS, to_ns + _ROUNDED_NS)
        except OSError as error:
            raise Refused(
                RefusalCode.CANNOT_WRITE, f"'{file.name}' cannot be copied: {error.strerror}"
            ) from None

    def _read(self, file: Path, *, waits: bool = False) -> _Recording:
        try:
            held = self._held.get(file)
            if waits and (held is None or held.is_whole):
                self._wait_until_written(file)
            return self._read_on(file)
        except OSError as error:
            raise Refused(
                RefusalCode.NO_JOURNAL, f"'{file.name}' cannot be read: {error.strerror}"
            ) from None

    def _read_on(self, file: Path) -> _Recording:
        size = recording_size(file)
        if size > _LARGEST:
            raise Refused(
                RefusalCode.TOO_LARGE,
                f"'{file.name}' has {size} bytes, at most {_LARGEST} are shown",
            )
        held = self._held.pop(file, None)
        if held is None or not held.read_on(size):
            held = _Recording(file, self._mood, self._namespace)
            held.read_on(size)
        self._held[file] = held
        while len(self._held) > MOST_HELD:
            self._held.popitem(last=False)
        return held

    def _wait_until_written(self, file: Path) -> None:
        """Wait for a change of a file, which does not happen while the system is quiet."""
        before = file.stat().st_mtime_ns
        for _ in range(round(WRITTEN_S / _LOOK_S)):
            if file.stat().st_mtime_ns != before:
                return
            self._sleep(_LOOK_S)


class _Recording:
    """The part of a recording that has been read, and its history.

    Attributes:
        store: Entries after the last message that has been read.
        history: Earlier entries.
        is_whole: Whether all of the file has been read.
    """

    def __init__(self, file: Path, mood: str, namespace: str) -> None:
        self._file = file
        self._namespace = namespace
        self._reader: JournalReader | None = None
        self._identity = (0, 0)
        self._size = 0
        self._moment = 0.0
        self.is_whole = False
        unlimited = float("inf")
        self.history = History(unlimited, unlimited, _MOST_BYTES)
        most = {**MOST_ENTRIES, "events": _MOST_EVENTS}
        self.store = Store(most, self._record, is_in_use=is_in_use)
        self._projection = Projection(self.store, mood)

    def read_on(self, size: int) -> bool:
        """Read some thousand further messages; return False if the file was replaced.

        A bag counts as replaced after each change.

        Raises:
            OSError: The file is gone.
            Refused: ``UNREADABLE``.
        """
        stat = self._file.stat()
        identity = (stat.st_dev, stat.st_ino)
        is_longer = size > self._size
        if self._reader is None:
            self._reader = _reader(self._file, self._namespace)
        elif (
            identity != self._identity or size < self._size or (is_longer and self._file.is_dir())
        ):
            return False
        elif not is_longer and self.is_whole:
            return True
        self._identity, self._size = identity, size
        self._take(self._reader)
        return True

    def _take(self, reader: JournalReader) -> None:
        try:
            entries = reader.further_entries(frozenset(self._projection.types))
        except BtAgentsError as error:
            raise Refused(RefusalCode.UNREADABLE, str(error)) from None
        self.is_whole = reader.is_at_end
        for entry in entries:
            self._moment = entry.sent_ns * 1e-9
            live = entry.topic.endswith("/live")
            try:
                self._projection.handle(entry.type, entry.decode(), self._moment, live=live)
            except Exception:
                # Of an earlier format, of other types, or damaged: show the readable part.
                continue

    def _record(self, change: Change) -> None:
        self.history.record(self._moment, change)


def moment_of(
    store: Store, history: History, at_s: float, source: str = "", *, is_whole: bool = True
) -> Moment:
    """Return the entries of a store at a moment [s since 1970], without events.

    The page always shows all events, including later ones.
    """
    snapshot = Snapshot(
        sequence=0,
        at_s=at_s,
        source=source,
        first_s=history.first_s,
        last_s=history.last_s,
        bookmarks=store.values("bookmarks", BookmarkRecord),
        is_whole=is_whole,
        entries={},
    )
    return Moment(snapshot=snapshot, entries=history.at(at_s))


def _reader(file: Path, namespace: str) -> JournalReader:
    try:
        from bt_agents_lab.recorder.reading import JournalReader

        return JournalReader([file], namespace)
    except ModuleNotFoundError as error:
        raise Refused(RefusalCode.UNREADABLE, journal_needs(error.name)) from None
    except BtAgentsError as error:
        raise Refused(RefusalCode.UNREADABLE, str(error)) from None


def recording_size(path: Path) -> int:
    """Return the size of a journal file, or of all files of a bag [bytes].

    Raises:
        OSError: The file is gone.
    """
    files = path.iterdir() if path.is_dir() else (path,)
    return sum(one.stat().st_size for one in files)
