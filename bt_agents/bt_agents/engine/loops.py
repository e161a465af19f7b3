# SPDX-License-Identifier: Apache-2.0
"""Modifiers that start a node again, after a pause: while it fails, or while it succeeds."""

from __future__ import annotations

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.halting import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.modifiers import NodeDecorator
from bt_agents.engine.node_errors import reason_of


class Loop(NodeDecorator):
    """Counts rounds; each starts at a tick of its own, no earlier than a pause after the last.

    During the pause the loop is RUNNING and its node is not ticked. Counts and pauses may be
    tuned; they are looked at when a round has ended, the pause also while it lasts.
    """

    _round = 1
    _words = ""
    _pause_from: float | None = None

    def initialise(self) -> None:
        """Begin with the first round."""
        self._round = 1
        self._words = ""
        self._pause_from = None

    def bypass(self) -> Status | None:
        """Look at the clock during a pause."""
        if self._pause_from is None or self.status is not RUNNING:
            return None
        try:
            pause = self.fields.seconds("pause")
        except Exception as error:
            return self.fail(reason_of(error))
        if not self.context.reached(self.spec.path, self._pause_from + pause):
            return RUNNING
        self._pause_from = None
        return None

    def tip(self) -> Behaviour | None:
        """Return the loop itself during a pause, as nothing below it runs."""
        if self.status is RUNNING and self._pause_from is not None:
            return self
        return super().tip()

    def decide(self) -> Status:
        """Return what a round's end means; while it runs, say which it is."""
        if self.decorated.status is not RUNNING:
            return self.ended(self.decorated.status)
        self.feedback_message = self._words
        return RUNNING

    def ended(self, status: Status) -> Status:
        """Return the status after a round has ended; may raise."""
        raise NotImplementedError

    def exhausted(self, limit: int | None) -> bool:
        """Return whether all rounds are over; None is no limit."""
        return limit is not None and self._round >= limit

    def again(self, word: str, limit: int | None) -> Status:
        """Begin the next round, or its pause."""
        pause = self.fields.seconds("pause")
        self._round += 1
        self._pause_from = self.context.clock()
        if pause:
            self.context.wake(self.spec.path, self._pause_from + pause)
        self._words = f"{word} {self._round}" + ("" if limit is None else f" of {limit}")
        self.feedback_message = self._words + (f", after a pause of {pause:g} s" if pause else "")
        return RUNNING


class Retry(Loop):
    """Starts the node again after a FAILURE, up to a number of attempts in all."""

    def ended(self, status: Status) -> Status:
        """Count failures."""
        if status is not FAILURE:
            return status
        attempts = self.fields.count("attempts")
        if self.exhausted(attempts):
            times = "once" if self._round == 1 else f"{self._round} times"
            return self.fail(f"failed {times}")
        return self.again("attempt", attempts)


class Repeat(Loop):
    """Starts the node again after a SUCCESS, a number of times in all or until a condition holds.

    A FAILURE of the node ends it. A condition that cannot be evaluated does not hold yet.
    """

    def ended(self, status: Status) -> Status:
        """Count successes."""
        if status is not SUCCESS:
            return status
        if self._holds():
            return SUCCESS
        times = self.fields.count("times")
        if self.exhausted(times):
            return SUCCESS
        return self.again("round", times)

    def _holds(self) -> bool:
        try:
            return "until" in self.fields and self.fields.holds("until")
        except Exception:
            return False
