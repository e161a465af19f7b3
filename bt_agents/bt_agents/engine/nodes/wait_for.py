# SPDX-License-Identifier: Apache-2.0
"""Wait_for: SUCCESS when a condition is true or a message has arrived."""

from __future__ import annotations

import math
from collections.abc import Mapping

from py_trees.common import Status

from bt_agents.engine.bases import Leaf
from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.environment import Clock, Inbox
from bt_agents.engine.light_behaviour import RUNNING, SUCCESS
from bt_agents.engine.scope import MessageNames, Scope, explain_false, field_of
from bt_agents_core.field_types import Plain
from bt_agents_language.expression.expressions import MissingValue, StaleValue
from bt_agents_language.model.specs import NodeSpec

EXPLAINED_S = 1.0
"""Shortest time between two explanations of a message that does not fit [s]: topics are fast."""


class _Hold:
    """Start of the time in which something has been continuously true, on the trees' clock."""

    def __init__(self) -> None:
        self._since: float | None = None

    def update(self, true_now: bool, clock: Clock) -> None:
        """Set whether it is true now."""
        if not true_now:
            self._since = None
        elif self._since is None:
            self._since = clock()

    def due(self, seconds: float) -> float:
        """Return when it will have been true for ``seconds`` [s]; infinite while it is false."""
        return math.inf if self._since is None else self._since + seconds


class WaitForCondition(Leaf):
    """SUCCESS once a condition has been true for a time; with a missing value it is not true."""

    def begin(self) -> None:
        self._hold = _Hold()
        self._unknown: MissingValue | None = None
        self._explanation = ""

    def step(self) -> Status:
        self._hold.update(self._is_true(), self.context.clock)
        due = self._hold.due(self.fields.seconds("for"))
        return SUCCESS if self.context.is_due(self.spec.path, due) else RUNNING

    def missing(self) -> str:
        """Return the current values of its names, unless the condition is already true."""
        return self._explain_false() if self.feedback_message else ""

    def _is_true(self) -> bool:
        before, self._unknown = self._unknown, None
        try:
            if self.fields.is_true("condition"):
                return True
        except MissingValue as missing:
            self._unknown = missing
        # Formatted once: with current values the message would change at each tick.
        if not self._explanation or _kind(before) != _kind(self._unknown):
            self._explanation = self._explain_false()
        self.feedback_message = self._explanation
        return False

    def _explain_false(self) -> str:
        if isinstance(self._unknown, StaleValue):
            return str(self._unknown)
        if self._unknown is not None:
            return f"{self._unknown} yet"
        return self.fields.explain_false("condition", verb="not so yet")


def _kind(unknown: MissingValue | None) -> tuple[type, str] | None:
    return None if unknown is None else (type(unknown), unknown.name)


class WaitForMessage(Leaf):
    """SUCCESS after a matching message that no other message contradicts for a time.

    A message holds until the next one. Without a time, the first match is enough.
    """

    changes_values = True
    _inbox: Inbox | None = None
    _unfit: MessageNames | None = None

    def begin(self) -> None:
        self._unfit, self._mismatch, self._explain_at = None, "", -math.inf
        self._hold = _Hold()
        self._message: Mapping[str, Plain] = {}
        topic, type_name = str(self.fields.value("topic")), str(self.fields.value("type"))
        latched = self.fields.constant("latched", False) is True
        self._inbox = self.context.environment.watch(topic, type_name, latched=latched)

    def step(self) -> Status:
        assert self._inbox is not None
        seconds = self.fields.seconds("for")
        while (message := self._inbox.take()) is not None:
            fits = self._fits(message)
            self._hold.update(fits, self.context.clock)
            if fits:
                self._message = message
                if seconds == 0:
                    break
        if not self.context.is_due(self.spec.path, self._hold.due(seconds)):
            self.feedback_message = self._explained() or self._inbox.problem
            return RUNNING
        found = {
            name: field_of(self._message, path, f"msg.{path}")
            for name, path in self.spec.outputs.items()
        }
        for name, value in found.items():
            self.write(name, value)
        return SUCCESS

    def missing(self) -> str:
        if self._unfit is None:
            return ""
        until = self.fields.condition("until")
        return explain_false(until, self._unfit, verb="the last message is not so")

    def end(self) -> None:
        if self._inbox is not None:
            inbox, self._inbox = self._inbox, None
            inbox.close()

    def _fits(self, message: Mapping[str, Plain]) -> bool:
        if "until" not in self.fields:
            return True
        names = MessageNames(prefix="msg", message=message, around=self.scope)
        fits = self.fields.condition("until").is_true(names.lookup)
        self._unfit = None if fits else names
        return fits

    def _explained(self) -> str:
        now = self.context.clock()
        if now >= self._explain_at and (text := self.missing()) != self._mismatch:
            self._mismatch, self._explain_at = text, now + EXPLAINED_S
        return self._mismatch


def wait_for(spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild) -> Leaf:
    """Return the leaf of a ``wait_for``; it waits for a message if the node names a topic."""
    leaf = WaitForMessage if "topic" in spec.fields else WaitForCondition
    return leaf(spec, context, scope, build)


BEHAVIOURS = {"wait_for": wait_for}
