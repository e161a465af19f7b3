# SPDX-License-Identifier: Apache-2.0
"""Formats errors of nodes with the reason, the node path and the place in the file."""

from __future__ import annotations

from bt_agents_core.errors import LONGEST_REASON, Refused
from bt_agents_core.text import ellipsize, printable
from bt_agents_language.expression.expression_values import EvaluationError, Undecided
from bt_agents_language.expression.expressions import MissingValue
from bt_agents_language.model.specs import NodeSpec


def reason_of(error: Exception) -> str:
    """Return the reason for an error in words."""
    match error:
        case Refused():
            return error.reason
        case Undecided():
            return UndecidedReason(error)
        case MissingValue() | EvaluationError():
            return str(error)
    return ellipsize(f"{type(error).__name__}: {printable(str(error))}", LONGEST_REASON)


class UndecidedReason(str):
    """A reason: a condition that cannot be decided."""


class LocatedReason(str):
    """A reason with the node's path and its place in the file."""

    path: str
    undecided: bool


def with_location(reason: str, spec: NodeSpec) -> LocatedReason:
    """Return the reason of a node with its path and its place in the file."""
    text = LocatedReason(f"{reason} ({spec.path}, {spec.position})")
    text.path = spec.path
    text.undecided = isinstance(reason, UndecidedReason)
    return text


def is_undecided(message: str) -> bool:
    """Return whether the message of a node says that its condition cannot be decided."""
    return isinstance(message, LocatedReason) and message.undecided
