# SPDX-License-Identifier: Apache-2.0
"""Steps of a recording: the entry of each, and the clocks, which are frozen during a step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from bt_agents.engine.environment import Clock
from bt_agents.recording.format import Entry


class StepLog:
    """Collects the entries of the steps, one at a time, for all recording proxies.

    Attributes:
        step: Number of ended steps; −1 before the start of the recording.
        began: Whether a call of the host has started the current step before its tick.
        entry: Entry of the current step so far.
        closed: Whether recording has stopped; the outside is still frozen during a step.
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


class RecordingClock:
    """A clock whose time [s] is recorded under a key when it is read."""

    def __init__(self, clock: Clock, log: StepLog, key: str) -> None:
        self._clock = clock
        self._log = log
        self._key = key
        self._step: int | None = None
        self._now = self._recorded = math.nan

    def __call__(self) -> float:
        if self._step != self._log.step:
            self._step, self._now = self._log.step, self._clock()
        if self._now != self._recorded:
            self._log.entry[self._key] = self._recorded = self._now
        return self._now

    def is_due(self, at: float) -> bool:
        """Return whether a time [s] has come; while it has not, nothing is recorded.

        Replay gets the same answer: at the last recorded time, it has not come either.
        """
        if self._step != self._log.step:
            self._step, self._now = self._log.step, self._clock()
        return not self._recorded <= self._now < at and self() >= at


class ReplayClock:
    """A clock that shows the times [s] recorded under a key."""

    def __init__(self, key: str) -> None:
        self._key = key
        self._now = 0.0

    def __call__(self) -> float:
        return self._now

    def load(self, entry: Mapping[str, Any]) -> None:
        """Begin a step with its entry."""
        self._now = float(entry.get(self._key, self._now))
