# SPDX-License-Identifier: Apache-2.0
"""Base class of the decorators that restart their child."""

from __future__ import annotations

from typing import ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.bases import Decorator
from bt_agents.engine.light_behaviour import RUNNING


class Loop(Decorator):
    """Counts rounds; each starts in a new tick, after a pause since the previous one.

    Counts and pauses can be tuned; they are evaluated at the end of a round, the pause also while
    it lasts.

    Attributes:
        limit_field: The field with the total number of rounds.
    """

    limit_field: ClassVar[str]
    _limit: int | None = None
    _round = 1
    _label = ""
    _pause_from: float | None = None

    def initialise(self) -> None:
        self._round = 1
        self._label = ""
        self._pause_from = None

    def short_circuit(self) -> Status | None:
        if self._pause_from is None or self.status is not RUNNING:
            return None
        pause = self.fields.seconds("pause")
        if not self.context.is_due(self.spec.path, self._pause_from + pause):
            return RUNNING
        self._pause_from = None
        return self.begun()

    def tip(self) -> Behaviour | None:
        """Return the loop itself during a pause, when nothing below it runs."""
        if self.status is RUNNING and self._pause_from is not None:
            return self
        return super().tip()

    def decide(self) -> Status:
        if self.decorated.status is not RUNNING:
            return self.ended(self.decorated.status)
        self.feedback_message = self._label
        return RUNNING

    def ended(self, status: Status) -> Status:
        """Return the status after a round has ended; may raise."""
        raise NotImplementedError

    def begun(self) -> Status | None:
        """Return the final status if there is no next round after all; None if it begins."""
        return None

    @property
    def rounds_left(self) -> int | None:
        """Rounds after the current one; None without a limit or while it is unknown."""
        limit = self._limit or self.fields.constant(self.limit_field)
        return max(limit - self._round, 0) if isinstance(limit, int) else None

    def exhausted(self, limit: int | None) -> bool:
        """Return whether all rounds are over; a ``limit`` of None means no limit."""
        self._limit = limit
        return limit is not None and self._round >= limit

    def again(self, noun: str, limit: int | None) -> Status:
        """Begin the next round or the pause before it."""
        pause = self.fields.seconds("pause")
        self._round += 1
        self._pause_from = self.context.clock()
        if pause:
            self.context.deadlines[self.spec.path] = self._pause_from + pause
        self._label = f"{noun} {self._round}" + ("" if limit is None else f" of {limit}")
        self.feedback_message = self._label + (f", after a pause of {pause:g} s" if pause else "")
        return RUNNING
