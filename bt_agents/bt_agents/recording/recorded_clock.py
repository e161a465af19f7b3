# SPDX-License-Identifier: Apache-2.0
"""Clocks that stand still during a step: one that is recorded, and one that is replayed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from bt_agents.engine.environment import Clock
from bt_agents.recording.step_log import StepLog


class RecordingClock:
    """A clock whose time is recorded when it is read.

    Args:
        clock: Returns the time [s].
        log: Takes the entries.
        key: Under which the time is recorded.
    """

    def __init__(self, clock: Clock, log: StepLog, key: str) -> None:
        self._clock = clock
        self._log = log
        self._key = key
        self._step: int | None = None
        self._now = self._recorded = math.nan

    def __call__(self) -> float:
        """Return the time of this step [s]."""
        if self._step != self._log.step:
            self._step, self._now = self._log.step, self._clock()
        if self._now != self._recorded:
            self._log.entry[self._key] = self._recorded = self._now
        return self._now

    def is_due(self, at: float) -> bool:
        """Return whether a time has come [s]; as long as it has not, nothing is recorded.

        By the time that was recorded last, it has not come either.
        """
        if self._step != self._log.step:
            self._step, self._now = self._log.step, self._clock()
        return not self._recorded <= self._now < at and self() >= at


class ReplayClock:
    """A clock that shows the recorded times.

    Args:
        key: Under which the time was recorded.
    """

    def __init__(self, key: str) -> None:
        self._key = key
        self._now = 0.0

    def __call__(self) -> float:
        """Return the time of this step [s]."""
        return self._now

    def load(self, entry: Mapping[str, Any]) -> None:
        """Begin a step with its entry."""
        self._now = float(entry.get(self._key, self._now))
