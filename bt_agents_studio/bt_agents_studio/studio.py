# SPDX-License-Identifier: Apache-2.0
"""Studio: the state of a running system, its last minutes, and its journals."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_studio.history import History
from bt_agents_studio.projection import Projection
from bt_agents_studio.records import MOST_ENTRIES, Json, ParameterRecord, PartRecord
from bt_agents_studio.store import Change, Store

SILENT_S = 1.0
"""Time without a heartbeat after which a part counts as gone [s]."""

MOST_JOURNALS = 2
"""Journal files that are held in memory."""

_LARGEST_JOURNAL = 512 * 1024 * 1024
_SUFFIX = ".mcap"


class Studio:
    """State of one system as it is shown, and as it was.

    Args:
        name: Of this start of the studio.
        space: The scene parameters.
        journal: Folder of journal files; None for none.
        clock: Time of day [s since 1970].

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
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.name = name
        self.parameters = tuple(_record(one, space.mood) for one in space.parameters)
        self._mood = space.mood or ""
        self.history = History()
        self.store = Store(MOST_ENTRIES, self._record)
        self._journal = journal
        self._clock = clock
        self._projection = Projection(self.store, self._mood)
        self._journals: OrderedDict[tuple[str, int, int], History] = OrderedDict()

    def receive(self, kind: str, message: Any, at_s: float, live: bool) -> None:
        """Take a message of the running system; see :meth:`Projection.handle`."""
        self._projection.handle(kind, message, at_s, live=live)

    def value(self, host: str, name: str, value: Json) -> None:
        """Take the current value of a tunable."""
        self._projection.value(host, name, value)

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
        for part in self.store.keys("parts"):
            record = self.store.get("parts", part)
            assert isinstance(record, PartRecord)
            if record.alive and now - record.seen_s > SILENT_S:
                self.store.put("parts", part, replace(record, alive=False))

    def journals(self) -> list[tuple[str, int]]:
        """Return names and sizes [bytes] of the journal files, the newest first."""
        if self._journal is None:
            return []
        try:
            files = [one for one in self._journal.iterdir() if one.suffix == _SUFFIX]
            return [(one.name, one.stat().st_size) for one in sorted(files, reverse=True)]
        except OSError:
            return []

    def recorded(self, source: str) -> History:
        """Return the history of a journal file by its name.

        Raises:
            Refused: ``NO_JOURNAL``, ``TOO_LARGE`` or ``UNREADABLE``.
        """
        names = [name for name, _ in self.journals()]
        if self._journal is None or source not in names:
            raise Refused("NO_JOURNAL", f"there is no journal '{source[:80]}'")
        file = self._journal / source
        state = file.stat()
        key = (source, state.st_size, state.st_mtime_ns)
        if key not in self._journals:
            if state.st_size > _LARGEST_JOURNAL:
                raise Refused(
                    "TOO_LARGE",
                    f"'{source}' has {state.st_size} bytes, at most {_LARGEST_JOURNAL} are shown",
                )
            self._journals[key] = read_journal(file, self._mood)
            while len(self._journals) > MOST_JOURNALS:
                self._journals.popitem(last=False)
        self._journals.move_to_end(key)
        return self._journals[key]

    def _record(self, change: Change) -> None:
        self.history.record(self._clock(), change)


def read_journal(file: Path, mood: str) -> History:
    """Return the history that a journal file holds.

    Raises:
        Refused: ``UNREADABLE``.
    """
    try:
        from bt_agents_lab.recorder.reading import JournalReader
    except ModuleNotFoundError as error:
        raise Refused(
            "UNREADABLE",
            f"a journal needs the package {error.name}; install it with "
            "pip install 'bt-agents[lab]'",
        ) from None
    history = History(span_s=float("inf"))
    moment = 0.0

    def record(change: Change) -> None:
        history.record(moment, change)

    projection = Projection(Store(MOST_ENTRIES, record), mood)
    try:
        for entry in JournalReader([file]).entries(frozenset(projection.types)):
            moment = entry.sent_ns * 1e-9
            live = entry.topic.endswith("/live")
            try:
                projection.handle(entry.type, entry.decode(), moment, live=live)
            except (AttributeError, BtAgentsError, ValueError):
                # Of an earlier format, or damaged: what can be read is shown.
                continue
    except BtAgentsError as error:
        raise Refused("UNREADABLE", str(error)) from None
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
