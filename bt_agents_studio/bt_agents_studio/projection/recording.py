# SPDX-License-Identifier: Apache-2.0
"""Recordings of the journal, and their bookmarks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bt_agents_studio.projection.conversion import record_of
from bt_agents_studio.projection.event_log import EventLog
from bt_agents_studio.records import BookmarkRecord, EventRecord, RecordingRecord
from bt_agents_studio.store import Store

RECORDING = "recording"
"""Key of the event of the current recording."""


class RecordingProjection:
    """Messages of a recorder → ``recording``, ``bookmarks``.

    Args:
        store: Store of the entries.
        log: Log of events.
    """

    def __init__(self, store: Store, log: EventLog) -> None:
        self._store = store
        self._log = log
        self.handlers = {
            "bt_agents_interfaces/msg/Bookmark": self._bookmark,
            "bt_agents_interfaces/msg/RecordingStatus": self._recording,
        }

    def lose(self, at_s: float) -> None:
        """Record that no journal runs."""
        self._store.remove("recording", "")
        self._end(at_s)

    def _recording(self, message: Any, _at_s: float) -> None:
        record = record_of(RecordingRecord, message)
        before = self._store.get("recording")
        is_same = isinstance(before, RecordingRecord) and before.since_s == record.since_s
        if not is_same:
            self._end(record.since_s)
        self._store.put("recording", "", record)
        if record.recording:
            text = record.label or record.file
            span = (record.since_s, None)
            self._log.event(RECORDING, "RECORDING", "RECORDING", span, text=text)

    def _end(self, ended_s: float) -> None:
        """Record the end of the current recording, if there is one."""
        event = self._store.get("events", RECORDING)
        if isinstance(event, EventRecord):
            self._store.remove("events", RECORDING)
            ended = replace(event, kind="RECORDED", ended_s=ended_s)
            self._store.put("events", f"{RECORDING} {event.began_s}", ended)

    def _bookmark(self, message: Any, at_s: float) -> None:
        record = record_of(BookmarkRecord, message)
        self._store.put("bookmarks", f"{record.at_s:.6f}", record)
        text = f"{record.label or 'a moment'} is marked"
        author = f" by {record.author}" if record.author else ""
        self._log.line(at_s, "journal", text=text + author)
