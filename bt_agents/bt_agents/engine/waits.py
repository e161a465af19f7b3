# SPDX-License-Identifier: Apache-2.0
"""Leaves that wait: for a time, for a condition to hold, for a message."""

from __future__ import annotations

import math
from collections.abc import Mapping

from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.environment import Clock, Inbox
from bt_agents.engine.leaves import Leaf
from bt_agents.engine.scope import MessageNames, Scope, field_of, holds, not_so
from bt_agents_core.field_types import Plain
from bt_agents_language.expression.expressions import MissingValue, StaleValue
from bt_agents_language.model.specs import Literal, NodeSpec


class Wait(Leaf):
    """SUCCESS after a time; the time may be tuned while it passes."""

    _start = 0.0

    def begin(self) -> None:
        """Note the start."""
        self._start = self.context.clock()

    def step(self) -> Status:
        """Look at the clock."""
        whole = self.fields.seconds("duration")
        if self.context.reached(self.spec.path, self._start + whole):
            return Status.SUCCESS
        if not isinstance(self.spec.fields["duration"], Literal):
            self.feedback_message = f"{whole:g} s"
        return Status.RUNNING


class _Hold:
    """Since when something has held without a break, on the trees' clock."""

    def __init__(self) -> None:
        self._since: float | None = None

    def see(self, holds_now: bool, clock: Clock) -> None:
        """Note whether it holds now."""
        if not holds_now:
            self._since = None
        elif self._since is None:
            self._since = clock()

    def due(self, seconds: float) -> float:
        """Return when it will have held for so long [s]; infinite when it does not hold."""
        return math.inf if self._since is None else self._since + seconds


class WaitForCondition(Leaf):
    """SUCCESS when a condition has held for a time; one whose value is missing does not hold."""

    def begin(self) -> None:
        """Start without having seen anything."""
        self._hold = _Hold()
        self._unknown: MissingValue | None = None
        self._words = ""

    def step(self) -> Status:
        """Look at the condition."""
        self._hold.see(self._holds(), self.context.clock)
        due = self._hold.due(self.fields.seconds("for"))
        return Status.SUCCESS if self.context.reached(self.spec.path, due) else Status.RUNNING

    def _holds(self) -> bool:
        before, self._unknown = self._unknown, None
        try:
            if self.fields.holds("condition"):
                return True
        except MissingValue as missing:
            self._unknown = missing
        # Said once: what the names are would be news at each tick.
        if not self._words or _kind(before) != _kind(self._unknown):
            self._words = self._not_so()
        self.feedback_message = self._words
        return False

    def missing(self) -> str:
        """Return what its names are now, unless the condition holds already."""
        return self._not_so() if self.feedback_message else ""

    def _not_so(self) -> str:
        if isinstance(self._unknown, StaleValue):
            return str(self._unknown)
        if self._unknown is not None:
            return f"{self._unknown} yet"
        return self.fields.not_so("condition", verb="not so yet")


def _kind(unknown: MissingValue | None) -> tuple[type, str] | None:
    return None if unknown is None else (type(unknown), unknown.name)


class WaitForMessage(Leaf):
    """SUCCESS when a message has come that fits, and for a time after it none that does not.

    What a message says holds until the next one. Without a time the first that fits is enough.
    """

    _inbox: Inbox | None = None
    _misfit = ""

    def begin(self) -> None:
        """Listen."""
        self._misfit = ""
        self._hold = _Hold()
        self._message: Mapping[str, Plain] = {}
        topic, type_name = str(self.fields.value("topic")), str(self.fields.value("type"))
        latched = self.fields.constant("latched", False) is True
        self._inbox = self.context.watch(topic, type_name, latched=latched)

    def step(self) -> Status:
        """Look at what has come."""
        assert self._inbox is not None
        seconds = self.fields.seconds("for")
        while (message := self._inbox.take()) is not None:
            fits = self._fits(message)
            self._hold.see(fits, self.context.clock)
            if fits:
                self._message = message
                if seconds == 0:
                    break
        if not self.context.reached(self.spec.path, self._hold.due(seconds)):
            self.feedback_message = self._misfit
            return Status.RUNNING
        found = {
            name: field_of(self._message, path, f"msg.{path}")
            for name, path in self.spec.outputs.items()
        }
        for name, value in found.items():
            self.scope.write(name, value)
        return Status.SUCCESS

    def _fits(self, message: Mapping[str, Plain]) -> bool:
        if "until" not in self.fields:
            return True
        names = MessageNames(prefix="msg", message=message, around=self.scope)
        until = self.fields.condition("until")
        fits = holds(until, names)
        self._misfit = "" if fits else not_so(until, names, verb="the last message is not so")
        return fits

    def missing(self) -> str:
        """Return what the last message said instead."""
        return self._misfit

    def end(self) -> None:
        """Stop listening."""
        if self._inbox is not None:
            inbox, self._inbox = self._inbox, None
            inbox.close()


def wait_for(spec: NodeSpec, context: RunContext, scope: Scope) -> Leaf:
    """Return the leaf of a ``wait_for``, which waits for a message if it names a topic."""
    kind = WaitForMessage if "topic" in spec.fields else WaitForCondition
    return kind(spec, context, scope)
