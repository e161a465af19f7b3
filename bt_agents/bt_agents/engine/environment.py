# SPDX-License-Identifier: Apache-2.0
"""Interface between trees and the outside: the non-blocking actions of leaves."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Protocol

from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import BindingKind, Plain
from bt_agents_core.local_time import LocalTime
from bt_agents_language.model.specs import REPLY_LIMIT_S, HeartbeatSpec, Timeouts

GIVE_FEEDBACK = "feedback/give"
"""ROS name of the service that takes feedback."""

Clock = Callable[[], float]
"""Returns the time [s]; only differences are meaningful."""


class GoalState(Enum):
    """State of a goal; the values are texts for people."""

    PENDING = "not accepted yet"
    ACTIVE = "running"
    SUCCEEDED = "succeeded"
    REJECTED = "rejected"
    ABORTED = "aborted"
    CANCELLED = "cancelled"
    TIMED_OUT = "timed out"
    UNREACHABLE = "unreachable"

    @property
    def ended(self) -> bool:
        """True when the state is final for its leaf."""
        return self not in (GoalState.PENDING, GoalState.ACTIVE)


@dataclass(frozen=True, kw_only=True)
class SkillGoal:
    """A goal of an action, a request of a service, or a message of a topic.

    Attributes:
        name: ROS name, relative unless it starts with a slash.
        fields: Goal, request or message as plain nested data.
        sender: Path of the node that sends it; empty for none.
        feedback: Whether the leaf uses the feedback of the action.
        timeouts: Time limits of the server.
        heartbeat: Topic whose silence means that the server is dead.
    """

    kind: BindingKind
    name: str
    type: str
    fields: Mapping[str, Plain]
    sender: str = ""
    feedback: bool = False
    timeouts: Timeouts = field(default_factory=Timeouts)
    heartbeat: HeartbeatSpec | None = None


def server_missing(limit_s: float) -> str:
    """Return the message that no server was found in time [s]."""
    return f"its server is not there (looked for {limit_s:g} s)"


def no_acceptance(limit_s: float) -> str:
    """Return the message that a server did not accept or reject a goal in time [s]."""
    return f"its server does not answer (no word about the goal for {limit_s:g} s)"


def no_result(kind: BindingKind, limit_s: float) -> str:
    """Return the message that a goal got no result, or a request no answer, in time [s]."""
    return f"no {'result' if kind is BindingKind.ACTION else 'answer'} within {limit_s:g} s"


def result_limit_s(kind: BindingKind, timeouts: Timeouts) -> float:
    """Return the time limit of the result or answer [s]; infinite for no limit."""
    if timeouts.result_s is not None:
        return timeouts.result_s
    return math.inf if kind is BindingKind.ACTION else REPLY_LIMIT_S


class GoalRun(Protocol):
    """A goal or request that was sent; ticks poll it and never wait for it."""

    @property
    def state(self) -> GoalState:
        """Its current state."""

    @property
    def confirmed(self) -> bool:
        """True when its server has certainly stopped working on it.

        A goal is confirmed if it was never sent, or once its server has reported that it rejected,
        finished or cancelled it. A goal that was given up or whose server is gone may still run
        and is not confirmed. A service request is confirmed as soon as its leaf is done with it,
        because it cannot be stopped.
        """

    @property
    def message(self) -> str:
        """Reason for the state in words, such as what it waits for; may be empty."""

    @property
    def result(self) -> Mapping[str, Plain]:
        """Fields of the result or response; empty until it has succeeded or aborted."""

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        """Fields of the latest feedback, the same object until newer feedback; None for none."""

    def cancel(self) -> None:
        """Request its end; a goal not accepted yet is cancelled on acceptance."""


class Inbox(Protocol):
    """Messages of a topic since it was opened; a burst may leave only the newest ones."""

    @property
    def problem(self) -> str:
        """Why the graph lets nothing new arrive, in words; empty for no known reason."""

    def take(self) -> Mapping[str, Plain] | None:
        """Return the oldest message not taken yet; None without one."""

    def close(self) -> None:
        """Unsubscribe."""


class PluginNode(Protocol):
    """The ROS node that the behaviour of a plug-in gets, for one leaf and one run."""

    @property
    def node(self) -> Any:
        """The argument ``node`` of ``setup``; it remembers everything created with it."""

    def open_goals(self) -> int:
        """Return how many of its goals are not confirmed to have ended."""

    def lost(self) -> str:
        """Return why a goal of this start will never get a result; empty if none is lost."""

    def settle(self) -> None:
        """Cancel every goal that still runs; one not accepted yet is cancelled on acceptance."""

    def plain(self, value: object) -> Plain:
        """Return a message as plain data, and anything else unchanged."""

    def close(self) -> None:
        """Destroy everything created with it."""


class Environment(Protocol):
    """Everything outside that a tree can access."""

    @property
    def clock(self) -> Clock:
        """The trees' clock, which may be simulated."""

    def local_time(self) -> LocalTime:
        """Return the local time, which may be simulated."""

    def send(self, goal: SkillGoal) -> GoalRun:
        """Send a goal to an action server or a request to a service."""

    def publish(self, goal: SkillGoal) -> None:
        """Publish a message.

        Raises:
            Refused: The fields do not fit the type.
        """

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> Inbox:
        """Subscribe to a topic; if it is latched, its last earlier message comes first."""

    def open_plugin_node(self, path: str) -> PluginNode | None:
        """Return the node for the plug-in at a path; None without ROS."""

    def log(self, level: str, text: str) -> None:
        """Write a line into the log; the level is ``info``, ``warning`` or ``error``."""

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> GoalRun:
        """Request a change of the running agent's profile.

        Direct feedback has wanted values by scene parameter; parameters without a value stay
        open. The request is rejected, with the reason, if nothing was changed.
        """
