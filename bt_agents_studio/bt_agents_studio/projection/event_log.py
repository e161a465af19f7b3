# SPDX-License-Identifier: Apache-2.0
"""Lines of the log, and events of the timeline."""

from __future__ import annotations

from typing import Any

from bt_agents_core.scene_labels import SceneLabels
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_studio.records import EventRecord, LogRecord
from bt_agents_studio.store import Store

_LONGEST_LINE = 1000
_LONGEST_EVENT = 200


class EventLog:
    """Lines and events, which name scenes by their labels.

    Args:
        store: Store of the entries.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._labels = SceneLabels()
        self._lines = 0

    def add_scene(self, message: Any) -> str:
        """Take a ``Scene``; return its name in later lines."""
        self._labels.add(message)
        return self._labels.name_of(message.scene_id)

    def line(self, at_s: float, kind: str, *, text: str, agent: str = "", path: str = "") -> None:
        """Add a line; ``kind`` is the part of the system that it concerns."""
        self._lines += 1
        text = ellipsize(self._labels.with_names(text), _LONGEST_LINE)
        record = LogRecord(at_s=at_s, kind=kind, agent=agent, path=path, text=text)
        self._store.put("log", str(self._lines), record)

    def event(
        self,
        key: str,
        lane: str,
        kind: str,
        span: tuple[float, float | None],
        *,
        text: str,
        agent: str = "",
    ) -> None:
        """Add or replace an event; see :class:`EventRecord`."""
        began_s, ended_s = span
        record = EventRecord(
            lane=lane,
            kind=kind,
            agent=agent,
            text=ellipsize(printable_line(self._labels.with_names(text)), _LONGEST_EVENT),
            began_s=began_s,
            ended_s=ended_s,
        )
        self._store.put("events", key, record)
