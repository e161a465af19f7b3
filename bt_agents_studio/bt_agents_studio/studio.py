# SPDX-License-Identifier: Apache-2.0
"""Studio: the state of a running system, its last minutes, and its journals."""

from __future__ import annotations

import logging
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.optional_packages import journal_needs
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_studio.history import History
from bt_agents_studio.projection import Projection, is_in_use
from bt_agents_studio.records import (
    MOST_ENTRIES,
    JournalRecord,
    Json,
    ListeningRecord,
    ParameterRecord,
    PartRecord,
    RecordingRecord,
)
from bt_agents_studio.store import Change, Store

SILENT_S = 1.0
"""Time without a heartbeat after which a part counts as gone [s]."""

MOST_JOURNALS = 2
"""Journal files that are held in memory."""

MOST_LABELS = 200
"""Journal files of which labels are read, the newest first."""

_LONGEST_REASON = 200
_LOGGER = logging.getLogger(__name__)

_LARGEST_JOURNAL = 512 * 1024 * 1024
_MOST_RECORDED_BYTES = 256 * 1024 * 1024
_WRITTEN_S = 1.2
"""The journal writes once a second what it has received [s]."""

_LOOK_S = 0.05
_SUFFIX = ".mcap"
_BAG = "metadata.yaml"
"""File that each bag of ``ros2 bag record`` has."""


class Studio:
    """State of one system as it is shown, and as it was.

    Args:
        name: Of this start of the studio.
        space: The scene parameters.
        journal: Folder of journal files and bags; None for none.
        namespace: Of the system, also in bags of several systems.
        clock: Time of day [s since 1970].
        sleep: Waits [s]; called where files are read.

    Attributes:
        parameters: The scene parameters, as a page gets them.
        store: What is shown.
        history: The last minutes of the store.
    """

    def __init__(
        self,
        name: str,
        *,
        space: SceneSpace,
        journal: Path | None = None,
        namespace: str = "",
        clock: Callable[[], float] = time.time,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.name = name
        self.parameters = tuple(_record(one, space.mood) for one in space.parameters)
        self._mood = space.mood or ""
        self.history = History()
        self.store = Store(MOST_ENTRIES, self._record, is_in_use=is_in_use)
        self._journal = journal
        self._namespace = namespace
        self._clock = clock
        self._sleep = sleep
        self._projection = Projection(self.store, self._mood)
        # Name → size at which it was read, and label.
        self._labels: dict[str, tuple[int, str]] = {}
        self._journals: OrderedDict[tuple[str, int, int], History] = OrderedDict()

    def receive(self, kind: str, message: Any, at_s: float, live: bool) -> None:
        """Take a message of the running system; see :meth:`Projection.handle`."""
        try:
            self._projection.handle(kind, message, at_s, live=live)
        except Exception as error:
            self.fail(kind.rpartition("/")[2], error)

    def fail(self, what: str, error: Exception) -> None:
        """Note that something that was received could not be shown; whatever follows goes on.

        The first failure of each kind is logged.

        Args:
            what: Type of the message, or name of what was done with it.
            error: Why it could not be shown.
        """
        if self._projection.fail(what, error, self._clock()):
            place = traceback.extract_tb(error.__traceback__)[-1:]
            where = "".join([f" ({Path(one.filename).name}:{one.lineno})" for one in place])
            reason = ellipsize(printable_line(str(error)), _LONGEST_REASON)
            _LOGGER.warning(
                "%s cannot be shown: %s: %s%s", what, type(error).__name__, reason, where
            )

    def value(self, host: str, name: str, value: Json) -> None:
        """Take the current value of a tunable."""
        self._projection.value(host, name, value)

    def graph(self, listening: Mapping[str, ListeningRecord], is_journal_there: bool) -> None:
        """Take what trees listen to now, by topic, and whether a journal runs."""
        self._projection.graph(listening, is_journal_there=is_journal_there)

    def beat(self, part: str) -> None:
        """Take a heartbeat; one is written down in a second, as long as they go on."""
        now = self._clock()
        before = self.store.get("parts", part)
        if (
            not isinstance(before, PartRecord)
            or not before.alive
            or now - before.seen_s >= SILENT_S / 2
        ):
            self.store.put("parts", part, PartRecord(alive=True, seen_s=now))

    def check_parts(self) -> None:
        """Note which parts have gone silent; call it a few times a second."""
        now = self._clock()
        self._projection.check_health(now)
        for part in self.store.keys("parts"):
            record = self.store.get("parts", part)
            assert isinstance(record, PartRecord)
            if record.alive and now - record.seen_s > SILENT_S:
                self.store.put("parts", part, replace(record, alive=False))

    def journals(self) -> list[tuple[str, int]]:
        """Return names and sizes [bytes] of the journal files and bags, the newest first."""
        if self._journal is None:
            return []
        try:
            inside = sorted(self._journal.iterdir(), reverse=True)
            return [(one.name, _size(one)) for one in inside if _is_recording(one)]
        except OSError:
            return []

    def journal_list(self) -> list[JournalRecord]:
        """Return the journal files with the labels under which they were begun, newest first."""
        found = self.journals()
        with suppress(ModuleNotFoundError):
            from bt_agents_lab.recorder.reading import recording_label

            for name, size in found[:MOST_LABELS]:
                # The label is in the file when its first messages are; a bag has none.
                is_new = self._labels.get(name, (0, ""))[0] != size
                if is_new and self._journal is not None and name.endswith(_SUFFIX):
                    self._labels[name] = (size, recording_label(self._journal / name))
        return [
            JournalRecord(name=name, bytes=size, label=self._labels.get(name, (0, ""))[1])
            for name, size in found
        ]

    def journal_file(self, name: str) -> Path:
        """Return the path of a journal file or bag by its name.

        Raises:
            Refused: ``NO_JOURNAL``.
        """
        if self._journal is None or name not in [one for one, _ in self.journals()]:
            raise Refused(RefusalCode.NO_JOURNAL, f"there is no journal '{name[:80]}'")
        return self._journal / name

    def recorded(self, source: str, at_s: float) -> History:
        """Return the history of a journal file or bag by its name; it may take its time.

        When a moment is wanted that is not over yet, of the file that is being written, it waits
        until the journal has written what it has received so far.

        Raises:
            Refused: ``NO_JOURNAL``, ``TOO_LARGE`` or ``UNREADABLE``.
        """
        file = self.journal_file(source)
        recording = self.store.get("recording")
        if (
            isinstance(recording, RecordingRecord)
            and recording.recording
            and recording.file == source
            and at_s > self._clock()
        ):
            self._wait_until_written(file)
        size = _size(file)
        key = (source, size, file.stat().st_mtime_ns)
        if key not in self._journals:
            if size > _LARGEST_JOURNAL:
                raise Refused(
                    RefusalCode.TOO_LARGE,
                    f"'{source}' has {size} bytes, at most {_LARGEST_JOURNAL} are shown",
                )
            self._journals[key] = read_journal(file, self._mood, self._namespace)
            while len(self._journals) > MOST_JOURNALS:
                self._journals.popitem(last=False)
        self._journals.move_to_end(key)
        return self._journals[key]

    def _wait_until_written(self, file: Path) -> None:
        """Wait for a change of a file, which does not come while the system is quiet."""
        before = file.stat().st_mtime_ns
        for _ in range(round(_WRITTEN_S / _LOOK_S)):
            if file.stat().st_mtime_ns != before:
                return
            self._sleep(_LOOK_S)

    def _record(self, change: Change) -> None:
        self.history.record(self._clock(), change)


def _is_recording(path: Path) -> bool:
    return path.suffix == _SUFFIX or (path / _BAG).is_file()


def _size(path: Path) -> int:
    """Return the bytes of a journal file, or of all files of a bag; raises OSError."""
    files = path.iterdir() if path.is_dir() else (path,)
    return sum(one.stat().st_size for one in files)


def read_journal(file: Path, mood: str, namespace: str = "") -> History:
    """Return the history that a journal file or a bag holds.

    Raises:
        Refused: ``UNREADABLE``.
    """
    try:
        from bt_agents_lab.recorder.reading import JournalReader
    except ModuleNotFoundError as error:
        raise Refused(RefusalCode.UNREADABLE, journal_needs(error.name)) from None
    history = History(span_s=float("inf"), most_bytes=_MOST_RECORDED_BYTES)
    moment = 0.0

    def record(change: Change) -> None:
        history.record(moment, change)

    projection = Projection(Store(MOST_ENTRIES, record, is_in_use=is_in_use), mood)
    try:
        for entry in JournalReader([file], namespace).entries(frozenset(projection.types)):
            moment = entry.sent_ns * 1e-9
            live = entry.topic.endswith("/live")
            try:
                projection.handle(entry.type, entry.decode(), moment, live=live)
            except Exception:
                # Of an earlier format, of other types, or damaged: what can be read is shown.
                continue
    except BtAgentsError as error:
        raise Refused(RefusalCode.UNREADABLE, str(error)) from None
    return history


def _record(parameter: SceneParameter, mood: str | None) -> ParameterRecord:
    return ParameterRecord(
        name=parameter.name,
        minimum=parameter.minimum,
        maximum=parameter.maximum,
        default=parameter.default,
        description=parameter.description,
        labels={f"{value:g}": label for value, label in parameter.labels.items()},
        is_mood=parameter.name == mood,
    )
