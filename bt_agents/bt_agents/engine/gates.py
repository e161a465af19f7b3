# SPDX-License-Identifier: Apache-2.0
"""Modifiers that leave a node out: unless a condition holds, after it was done, for a while."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.halting import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.modifiers import NodeDecorator
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents_language.expression.expressions import MissingValue

_ENDED = (SUCCESS, FAILURE)


class SkipDecorator(NodeDecorator):
    """Decides when the node would start whether it is left out.

    Left out means SUCCESS, or FAILURE below a selector, so that the next alternative is tried.
    """

    def obstacle(self) -> str:
        """Return why the node is left out, empty when it takes part; an error is a FAILURE."""
        raise NotImplementedError

    def bypass(self) -> Status | None:
        """Look at the start whether the node takes part."""
        if self.status is RUNNING:
            return None
        try:
            reason = self.obstacle()
        except Exception as error:
            return self.fail(reason_of(error))
        if not reason:
            return None
        self.feedback_message = f"left out: {reason}"
        failure = self.fields.constant("otherwise") == "failure"
        return FAILURE if failure else SUCCESS


class When(SkipDecorator):
    """Leaves the node out unless the condition is true when it would start."""

    def obstacle(self) -> str:
        """Look at the condition; one that cannot be evaluated is not true."""
        try:
            if self.fields.holds("condition"):
                return ""
        except MissingValue as missing:
            return reason_of(missing)
        except Exception as error:
            return with_location(reason_of(error), self.spec)
        return self.fields.not_so("condition")


class Once(SkipDecorator):
    """Leaves the node out after it has ended once in this run; one that was stopped has not."""

    _done = False

    def obstacle(self) -> str:
        """Remember."""
        return "done once already" if self._done else ""

    def decide(self) -> Status:
        """Note that the node has ended."""
        self._done = self.decorated.status in _ENDED
        return self.decorated.status


class Cooldown(SkipDecorator):
    """Leaves the node out for a time after it ended, on the tree's clock; it may be tuned."""

    _ended_at: float | None = None

    def obstacle(self) -> str:
        """Look at the clock."""
        if self._ended_at is None:
            return ""
        seconds = self.fields.seconds("duration")
        if self.context.reached(self.spec.path, self._ended_at + seconds):
            return ""
        return f"done less than {seconds:g} s ago"

    def decide(self) -> Status:
        """Note when the node ends."""
        if self.decorated.status in _ENDED:
            self._ended_at = self.context.clock()
        return self.decorated.status
