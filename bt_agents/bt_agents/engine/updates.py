# SPDX-License-Identifier: Apache-2.0
"""The updates of py_trees decorators that turn a status round, without slow look-ups."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from py_trees import decorators
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.halting import FAILURE, RUNNING, SUCCESS, method_of

Update = Callable[[Any, Any, Status], Status]
"""Takes a decorator, its child and the status of that; returns the new status."""


def update_of(node: Behaviour) -> Update | None:
    """Return what does the same as the node's own ``update``; None when that is not known."""
    return UPDATES.get(method_of(node, "update"))


def _inverted(node: Any, child: Any, status: Status) -> Status:
    if status is SUCCESS:
        node.feedback_message = "success -> failure"
        return FAILURE
    if status is FAILURE:
        node.feedback_message = "failure -> success"
        return SUCCESS
    node.feedback_message = child.feedback_message
    return status


def _turned(one: Status, into: Status) -> Update:
    """Return the update of a decorator that turns one status into another."""
    words = f"{one.name} is {into.name}".lower()

    def update(node: Any, child: Any, status: Status) -> Status:
        message = child.feedback_message
        if status is not one:
            node.feedback_message = message
            return status
        node.feedback_message = f"{words} [{message}]" if message else words
        return into

    return update


UPDATES: Mapping[object, Update] = {
    decorators.Inverter.update: _inverted,
    decorators.RunningIsFailure.update: _turned(RUNNING, FAILURE),
    decorators.RunningIsSuccess.update: _turned(RUNNING, SUCCESS),
    decorators.FailureIsSuccess.update: _turned(FAILURE, SUCCESS),
    decorators.FailureIsRunning.update: _turned(FAILURE, RUNNING),
    decorators.SuccessIsFailure.update: _turned(SUCCESS, FAILURE),
}
"""The ``update`` of a class → the same."""
