# SPDX-License-Identifier: Apache-2.0
"""The entry of the step that is being recorded, shared by all recording proxies."""

from __future__ import annotations

from bt_agents.recording.format import Entry


class StepLog:
    """Collects the entry of one step after the other.

    Attributes:
        step: Steps that have ended; −1 before the begin of the recording.
        began: Whether a call of the host has begun the current step before its tick.
        entry: What is recorded about the current step so far.
        closed: Whether nothing is recorded any more; the outside still stands still in a step.
    """

    def __init__(self) -> None:
        self.step = -1
        self.began = False
        self.entry: Entry = {}
        self.closed = False

    def add(self, key: str, item: Entry) -> None:
        """Append an item to a list of the entry."""
        if not self.closed:
            self.entry.setdefault(key, []).append(item)

    def end(self) -> Entry:
        """End the step; return its entry."""
        self.step += 1
        self.began = False
        entry, self.entry = self.entry, {}
        return entry
