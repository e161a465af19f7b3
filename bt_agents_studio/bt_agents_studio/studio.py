# SPDX-License-Identifier: Apache-2.0
"""Studio: the state of a running system, its last minutes, and its journals."""

from __future__ import annotations

import logging
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_studio.history import SPAN_S, History
from bt_agents_studio.projection import Projection, is_in_use
from bt_agents_studio.protocol import VERSION, Hello
from bt_agents_studio.recordings import recording_size
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

MOST_LABELS = 200
"""Maximum number of journal files whose labels are read, newest first."""

_LONGEST_REASON = 200
_LOGGER = logging.getLogger(__name__)

_SUFFIX = ".mcap"
_BAG = "metadata.yaml"
"""File in each bag of ``ros2 bag record``."""


class Studio:
    """Current and past state of one system.

    Args:
        name: Identifier of this start of the studio.
        space: The scene parameters.
        journal: Folder of journal files and bags; None for none.
        namespace: Namespace of the system, also in bags of several systems.
        clock: Time of day [s since 1970].

    Attributes:
        parameters: The scene parameters, as sent to a page.
        store: Entries to show.
        history: The last minutes of the store.
        mood: The scene parameter that is the mood; empty for none.
        namespace: Namespace of the system.
    """

    def __init__(
        self,
        name: str,
        *,
        space: SceneSpace,
        journal: Path | None = None,
        namespace: str = "",
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.name = name
        self.parameters = tuple(_record(one, space.mood) for one in space.parameters)
        self.history = History()
        self.store = Store(MOST_ENTRIES, self._record, is_in_use=is_in_use)
        self._journal = journal
        self.mood = space.mood or ""
        self.namespace = namespace
        self._clock = clock
        self._projection = Projection(self.store, self.mood)
        # Name → size when it was read, and label.
        self._labels: dict[str, tuple[int, str]] = {}

    def hello(self, role: str, namespace: str) -> Hello:
        """Return the first message to a client of a role."""
        return Hello(
            version=VERSION,
            studio=self.name,
            now_s=self._clock(),
            role=role,
            parameters=self.parameters,
            namespace=namespace,
            span_s=SPAN_S,
        )

    def receive(self, kind: str, message: Any, at_s: float, live: bool) -> None:
        """Handle a message of the running system; see :meth:`Projection.handle`."""
        try:
            self._projection.handle(kind, message, at_s, live=live)
        except Exception as error:
            self.fail(kind.rpartition("/")[2], error)

    def fail(self, what: str, error: Exception) -> None:
        """Record that a received message or value could not be shown; later ones still count.

        The first failure of each kind is logged.

        Args:
            what: Type of the message, or name of the failed step.
            error: Reason for the failure.
        """
        if self._projection.health.fail(what, error, self._clock()):
            place = traceback.extract_tb(error.__traceback__)[-1:]
            where = "".join([f" ({Path(one.filename).name}:{one.lineno})" for one in place])
            reason = ellipsize(printable_line(str(error)), _LONGEST_REASON)
            _LOGGER.warning(
                "%s cannot be shown: %s: %s%s", what, type(error).__name__, reason, where
            )

    def value(self, host: str, name: str, value: Json) -> None:
        """Take the current value of a tunable."""
        self._projection.agents.value(host, name, value)

    def graph(self, listening: Mapping[str, ListeningRecord], is_journal_there: bool) -> None:
        """Take the topics that trees subscribe to, and whether a journal runs."""
        self._projection.graph(listening, self._clock(), is_journal_there=is_journal_there)

    def beat(self, part: str) -> None:
        """Take a heartbeat; record only some of them."""
        now = self._clock()
        before = self.store.get("parts", part)
        if (
            not isinstance(before, PartRecord)
            or not before.alive
            or now - before.seen_s >= SILENT_S / 2
        ):
            self.store.put("parts", part, PartRecord(alive=True, seen_s=now))

    def check_parts(self) -> None:
        """Record which parts have become silent; call it a few times a second."""
        now = self._clock()
        self._projection.health.check(now)
        for part in self.store.keys("parts"):
            record = self.store.get("parts", part)
            assert isinstance(record, PartRecord)
            if record.alive and now - record.seen_s > SILENT_S:
                self.store.put("parts", part, replace(record, alive=False))

    def journals(self) -> list[tuple[str, int]]:
        """Return names and sizes [bytes] of the journal files and bags, newest first."""
        if self._journal is None:
            return []
        try:
            inside = sorted(self._journal.iterdir(), reverse=True)
            return [(one.name, recording_size(one)) for one in inside if _is_recording(one)]
        except OSError:
            return []

    def journal_list(self) -> list[JournalRecord]:
        """Return the journal files with their labels, newest first."""
        found = self.journals()
        with suppress(ModuleNotFoundError):
            from bt_agents_lab.recorder.reading import recording_label

            for name, size in found[:MOST_LABELS]:
                # The label is in the file once it has messages; a bag has none.
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

    def is_awaited(self, source: str, at_s: float) -> bool:
        """Return whether the journal may still write messages of a file's moment [s since 1970].

        True if the moment is not over yet and the file is being written.
        """
        recording = self.store.get("recording")
        return (
            isinstance(recording, RecordingRecord)
            and recording.recording
            and recording.file == source
            and at_s > self._clock()
        )

    def _record(self, change: Change) -> None:
        self.history.record(self._clock(), change)


def _is_recording(path: Path) -> bool:
    return path.suffix == _SUFFIX or (path / _BAG).is_file()


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
