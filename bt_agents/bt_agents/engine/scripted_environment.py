# SPDX-License-Identifier: Apache-2.0
"""Scripted environment on a manual clock, for tests and rehearsals."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from bt_agents.engine.environment import (
    GIVE_FEEDBACK,
    Clock,
    GoalState,
    SkillGoal,
    no_acceptance,
    no_result,
    result_limit_s,
)
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import BindingKind, Plain
from bt_agents_core.local_time import NOON, LocalTime


class ManualClock:
    """A clock that moves only by :meth:`advance`."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        """Return the time [s]."""
        return self.now

    def advance(self, seconds: float) -> None:
        """Advance by a time [s]."""
        self.now += seconds


@dataclass(frozen=True, kw_only=True)
class ScriptedReply:
    """Scripted behaviour of one goal.

    Attributes:
        state: How the goal ends.
        accept_s: Time until its acceptance [s].
        after_s: Time from sending until its end [s].
        cancel_s: Time that a cancel takes [s]; infinite for a server that ignores it.
        feedback: Increasing times since sending [s] with the fields of the feedback.
        vanishes: Whether the server is gone by then and never confirms the end.
    """

    state: GoalState = GoalState.SUCCEEDED
    result: Mapping[str, Plain] = field(default_factory=dict)
    message: str = ""
    accept_s: float = 0.0
    after_s: float = 0.0
    cancel_s: float = 0.0
    feedback: tuple[tuple[float, Mapping[str, Plain]], ...] = ()
    vanishes: bool = False


@dataclass(frozen=True, kw_only=True)
class GivenFeedback:
    """Feedback that a tree gave."""

    kind: FeedbackKind
    values: Mapping[str, float]
    reason: str


class ScriptedGoal:
    """Goal of a :class:`ScriptedEnvironment`; its timeouts use the same clock."""

    def __init__(self, goal: SkillGoal, answer: ScriptedReply, clock: Clock) -> None:
        self.goal = goal
        self.cancelled_at: float | None = None
        self._answer = answer
        self._clock = clock
        self._sent = clock()
        self._accepted = self._sent + answer.accept_s
        self._ends = self._sent + answer.after_s
        self._given_up, self._why = self._giving_up()

    @property
    def state(self) -> GoalState:
        now, cancelled = self._clock(), self._cancelled(self.cancelled_at)
        if self._is_given_up:
            return self._why[0]
        if now >= min(cancelled, self._ends):
            return GoalState.CANCELLED if cancelled < self._ends else self._answer.state
        return GoalState.ACTIVE if now >= self._accepted else GoalState.PENDING

    @property
    def confirmed(self) -> bool:
        # A request cannot be stopped; a cancel only ends the wait for it.
        given_up = self.state.ended or self.cancelled_at is not None
        if self.goal.kind is BindingKind.SERVICE and given_up:
            return True
        return self._clock() >= self._server_ends and not self._answer.vanishes

    @property
    def message(self) -> str:
        if self._is_given_up:
            return self._why[1]
        return self._answer.message if self.state.ended else ""

    @property
    def result(self) -> Mapping[str, Plain]:
        ended = self.state in (GoalState.SUCCEEDED, GoalState.ABORTED)
        return self._answer.result if ended else {}

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        until = min(self._clock(), self._server_ends)
        published = [fields for at, fields in self._answer.feedback if self._sent + at <= until]
        return published[-1] if published and self._clock() >= self._accepted else None

    @property
    def next_change(self) -> float:
        """When it changes next if it is not cancelled [s]; infinite for never."""
        if self.state.ended:
            return math.inf
        now = self._clock()
        feedback = [self._sent + at for at, _ in self._answer.feedback]
        moments = [self._accepted, self._given_up, self._server_ends, *feedback]
        return min((at for at in moments if at > now), default=math.inf)

    def cancel(self) -> None:
        if self.cancelled_at is None:
            self.cancelled_at = self._clock()

    def _giving_up(self) -> tuple[float, tuple[GoalState, str]]:
        """Return when it is given up [s], its state then, and the reason."""
        kind, timeouts = self.goal.kind, self.goal.timeouts
        if kind is BindingKind.ACTION and self._answer.accept_s > timeouts.accept_s:
            reason = no_acceptance(timeouts.accept_s)
            return self._sent + timeouts.accept_s, (GoalState.UNREACHABLE, reason)
        limit_s = result_limit_s(kind, timeouts)
        return self._accepted + limit_s, (GoalState.TIMED_OUT, no_result(kind, limit_s))

    @property
    def _is_given_up(self) -> bool:
        ends = min(self._cancelled(self.cancelled_at), self._ends)
        return self._given_up < ends and self._clock() >= self._given_up

    @property
    def _server_ends(self) -> float:
        """When the server is done with it [s]; giving it up cancels it."""
        asked = self.cancelled_at
        if asked is None and self._is_given_up:
            asked = self._given_up
        return min(self._cancelled(asked), self._ends)

    def _cancelled(self, asked: float | None) -> float:
        """Return when a cancel takes effect [s]; a cancel before acceptance waits for it."""
        if asked is None:
            return math.inf
        return max(asked, self._accepted) + self._answer.cancel_s


class ScriptedInbox:
    """Scripted messages on a topic since the inbox was opened."""

    problem = ""

    def __init__(self) -> None:
        self.messages: deque[Mapping[str, Plain]] = deque()
        self.closed = False

    def take(self) -> Mapping[str, Plain] | None:
        return self.messages.popleft() if self.messages else None

    def close(self) -> None:
        self.closed = True


class ScriptedEnvironment:
    """Answers goals by name and records all requests.

    Args:
        answers: Name of an action or service → answers in order; the last one repeats forever.
            A name that is not listed succeeds at once with an empty result.
        result: Fields of every result, unless its answer overrides them.
        begin: Local time when the clock shows 0.

    Attributes:
        clock: Clock of the trees.
    """

    def __init__(
        self,
        answers: Mapping[str, Sequence[ScriptedReply]] | None = None,
        result: Mapping[str, Plain] | None = None,
        begin: LocalTime = NOON,
    ) -> None:
        self.begin = begin
        self._result = dict(result or {})
        self.clock = ManualClock()
        self.goals: list[ScriptedGoal] = []
        self.published: list[SkillGoal] = []
        self.logged: list[tuple[str, str]] = []
        self.feedback_given: list[GivenFeedback] = []
        self._answers = {name: deque(queue) for name, queue in (answers or {}).items()}
        self._inboxes: list[tuple[str, ScriptedInbox]] = []
        self._last: dict[str, Mapping[str, Plain]] = {}

    def local_time(self) -> LocalTime:
        """Return the local time."""
        return self.begin.after(self.clock())

    def send(self, goal: SkillGoal) -> ScriptedGoal:
        """Record a goal or request."""
        answer = self._answer(goal.name)
        answer = replace(answer, result={**self._result, **answer.result})
        run = ScriptedGoal(goal, answer, self.clock)
        self.goals.append(run)
        return run

    def publish(self, goal: SkillGoal) -> None:
        """Record a message."""
        self.published.append(goal)

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> ScriptedInbox:
        """Open an inbox."""
        inbox = ScriptedInbox()
        if latched and topic in self._last:
            inbox.messages.append(self._last[topic])
        self._inboxes.append((topic, inbox))
        return inbox

    def open_plugin_node(self, path: str) -> None:
        """Return None, because there is no ROS."""

    def log(self, level: str, text: str) -> None:
        """Record a line."""
        self.logged.append((level, text))

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> ScriptedGoal:
        """Record feedback; it is accepted unless the service of this name answers otherwise."""
        self.feedback_given.append(GivenFeedback(kind=kind, values=values, reason=reason))
        fields: dict[str, Plain] = {"kind": int(kind), "values": values, "reason": reason}
        goal = SkillGoal(kind=BindingKind.SERVICE, name=GIVE_FEEDBACK, type="", fields=fields)
        return ScriptedGoal(goal, self._answer(GIVE_FEEDBACK), self.clock)

    def arrive(self, topic: str, message: Mapping[str, Plain]) -> bool:
        """Deliver a message to the open inboxes of a topic; return whether there are any.

        Latched inboxes opened later get it, too.
        """
        self._last[topic] = message
        inboxes = [one for name, one in self._inboxes if name == topic and not one.closed]
        for inbox in inboxes:
            inbox.messages.append(message)
        return bool(inboxes)

    def running(self) -> list[str]:
        """Return the names of the goals that their servers still execute."""
        return [run.goal.name for run in self.goals if not run.confirmed]

    def _answer(self, name: str) -> ScriptedReply:
        queue = self._answers.get(name) or deque([ScriptedReply()])
        return queue.popleft() if len(queue) > 1 else queue[0]
