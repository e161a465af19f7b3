# SPDX-License-Identifier: Apache-2.0
"""Modifiers: decorators written as a key beside the node they change."""

from __future__ import annotations

from collections.abc import Iterator

import py_trees
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.context import RunContext, place
from bt_agents.engine.leaves import duration, why
from bt_agents.engine.scope import Scope, evaluate, holds
from bt_agents.errors import Refused
from bt_agents.language.expressions import Expression, MissingValue
from bt_agents.language.specs import Literal, NodeSpec, Plain


class Modifier(py_trees.decorators.Decorator):
    """A decorator made from a spec; whatever it raises is a FAILURE that says where and why."""

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, child: Behaviour
    ) -> None:
        super().__init__(name=spec.name, child=child)
        self.spec = spec
        self.context = context
        self.scope = scope

    def decide(self) -> Status:
        """Return the status after the child was ticked; may raise."""
        raise NotImplementedError

    def update(self) -> Status:
        """Decide; an error is a FAILURE."""
        self.feedback_message = ""
        try:
            return self.decide()
        except Exception as error:
            return self.fail(why(error))

    def fail(self, reason: str) -> Status:
        """Note the reason and return FAILURE."""
        self.feedback_message = f"{reason} ({place(self.spec.path, self.spec.position)})"
        return Status.FAILURE

    def value(self, name: str) -> Plain:
        """Return what a field means now."""
        value = self.spec.fields[name]
        assert not isinstance(value, Expression)
        return evaluate(value, self.scope)

    def count(self, name: str) -> int:
        """Return what a counting field means now.

        Raises:
            Refused: ``NOT_A_COUNT``; it is no whole number from 1 on.
        """
        value = self.value(name)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise Refused("NOT_A_COUNT", f"{name} is {value!r}, expected a whole number from 1 on")
        return value


class When(Modifier):
    """Leaves the node out unless the condition is true when it would start.

    Left out means SUCCESS, or FAILURE below a selector, so that the next alternative is tried.
    """

    _left_out = False

    def tick(self) -> Iterator[Behaviour]:
        """Tick the child only when it takes part."""
        if self.status is not Status.RUNNING:
            self._left_out = not self._takes_part()
        if not self._left_out:
            yield from super().tick()
            return
        otherwise = self.spec.fields["otherwise"]
        failure = isinstance(otherwise, Literal) and otherwise.value == "failure"
        self.stop(Status.FAILURE if failure else Status.SUCCESS)
        yield self

    def _takes_part(self) -> bool:
        condition = self.spec.fields["condition"]
        assert isinstance(condition, Expression)
        self.feedback_message = f"left out: {condition.text}"
        try:
            return holds(condition, self.scope)
        except MissingValue as missing:
            self.feedback_message = f"left out: '{missing.name}' has no value"
        except Exception as error:
            self.fail(why(error))
        return False

    def decide(self) -> Status:
        """Return the child's status."""
        return self.decorated.status


class Retry(Modifier):
    """Starts the node again after a FAILURE, up to a number of attempts in all."""

    _attempt = 1

    def initialise(self) -> None:
        """Count from the first attempt."""
        self._attempt = 1

    def decide(self) -> Status:
        """Count failures."""
        if self.decorated.status is not Status.FAILURE:
            return self.decorated.status
        attempts = self.count("attempts")
        if self._attempt >= attempts:
            return self.fail(f"failed {self._attempt} times")
        self._attempt += 1
        self.feedback_message = f"attempt {self._attempt} of {attempts}"
        return Status.RUNNING


class Repeat(Modifier):
    """Starts the node again after a SUCCESS, a number of times in all."""

    _round = 1

    def initialise(self) -> None:
        """Count from the first round."""
        self._round = 1

    def decide(self) -> Status:
        """Count successes."""
        if self.decorated.status is not Status.SUCCESS:
            return self.decorated.status
        times = self.count("times")
        if self._round >= times:
            return Status.SUCCESS
        self._round += 1
        self.feedback_message = f"round {self._round} of {times}"
        return Status.RUNNING


class Timeout(Modifier):
    """FAILURE when the node runs longer than a time, on the tree's clock; it may be tuned."""

    _start = 0.0

    def initialise(self) -> None:
        """Note the start."""
        self._start = self.context.clock()

    def decide(self) -> Status:
        """Look at the clock."""
        if self.decorated.status is not Status.RUNNING:
            return self.decorated.status
        limit = duration(self.value("limit"), "timeout")
        if self.context.clock() - self._start < limit:
            return Status.RUNNING
        return self.fail(f"not done within {limit:g} s")


class Invert(Modifier):
    """SUCCESS for FAILURE and FAILURE for SUCCESS."""

    def decide(self) -> Status:
        """Turn the status round."""
        match self.decorated.status:
            case Status.SUCCESS:
                return self.fail("succeeded, and is inverted")
            case Status.FAILURE:
                return Status.SUCCESS
            case status:
                return status
