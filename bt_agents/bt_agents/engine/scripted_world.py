# SPDX-License-Identifier: Apache-2.0
"""A world that answers from a script on a clock turned by hand, for tests and rehearsals."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from bt_agents.engine.world import GIVE_FEEDBACK, Clock, Goal, GoalState
from bt_agents.feedback import Kind
from bt_agents.language.specs import BindingKind, Plain


class ManualClock:
    """A clock that moves only when told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        """Return the time [s]."""
        return self.now

    def advance(self, seconds: float) -> None:
        """Move on."""
        self.now += seconds


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a server does with one goal.

    Attributes:
        state: How the goal ends.
        result: Fields of its result.
        message: Why, in words.
        accept_s: Time until it is accepted [s].
        after_s: Time until it ends, from the moment it was sent [s].
        cancel_s: Time a cancel takes [s]; infinite for a server that ignores it.
    """

    state: GoalState = GoalState.SUCCEEDED
    result: Mapping[str, Plain] = field(default_factory=dict)
    message: str = ""
    accept_s: float = 0.0
    after_s: float = 0.0
    cancel_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class GivenFeedback:
    """Feedback that a tree has given."""

    kind: Kind
    values: Mapping[str, float]
    reason: str


class ScriptedGoal:
    """One goal of a :class:`ScriptedWorld`."""

    def __init__(self, goal: Goal, answer: Answer, clock: Clock) -> None:
        self.goal = goal
        self.cancelled_at: float | None = None
        self._answer = answer
        self._clock = clock
        self._accepted = clock() + answer.accept_s
        self._ends = clock() + answer.after_s

    @property
    def state(self) -> GoalState:
        """Where it is now."""
        now = self._clock()
        cancelled = self._cancelled
        if cancelled < self._ends and now >= cancelled:
            return GoalState.CANCELLED
        if now >= self._ends and self._ends <= cancelled:
            return self._answer.state
        return GoalState.ACTIVE if now >= self._accepted else GoalState.PENDING

    @property
    def _cancelled(self) -> float:
        """When a cancel takes effect [s]; one that comes before acceptance does so on it."""
        if self.cancelled_at is None:
            return math.inf
        return max(self.cancelled_at, self._accepted) + self._answer.cancel_s

    @property
    def next_change(self) -> float:
        """When it next becomes something else, unless it is cancelled [s]; infinite for never."""
        match self.state:
            case GoalState.PENDING:
                return min(self._accepted, self._ends)
            case GoalState.ACTIVE:
                return min(self._cancelled, self._ends)
        return math.inf

    @property
    def message(self) -> str:
        """Why it is there."""
        return self._answer.message

    @property
    def result(self) -> Mapping[str, Plain]:
        """Fields of the result once it succeeded."""
        return self._answer.result if self.state is GoalState.SUCCEEDED else {}

    def cancel(self) -> None:
        """Ask for the end."""
        if self.cancelled_at is None:
            self.cancelled_at = self._clock()


class ScriptedInbox:
    """Messages that a test or script put on a topic since the inbox was opened."""

    def __init__(self) -> None:
        self.messages: deque[Mapping[str, Plain]] = deque()
        self.closed = False

    def take(self) -> Mapping[str, Plain] | None:
        """Return the oldest message not taken yet."""
        return self.messages.popleft() if self.messages else None

    def close(self) -> None:
        """Stop listening."""
        self.closed = True


class ScriptedWorld:
    """Answers goals by name, remembers everything that was asked of it.

    Args:
        answers: Name of an action or service → answers in order; the last one is given for ever.
            A name that is not listed succeeds at once with an empty result.
        clock: Clock of the trees.
        result: Fields that every result has, unless its answer says otherwise.
    """

    def __init__(
        self,
        answers: Mapping[str, Sequence[Answer]] | None = None,
        clock: ManualClock | None = None,
        result: Mapping[str, Plain] | None = None,
    ) -> None:
        self._result = dict(result or {})
        self.clock = clock or ManualClock()
        self.goals: list[ScriptedGoal] = []
        self.published: list[Goal] = []
        self.logged: list[tuple[str, str]] = []
        self.feedback_given: list[GivenFeedback] = []
        self._answers = {name: deque(queue) for name, queue in (answers or {}).items()}
        self._inboxes: list[tuple[str, ScriptedInbox]] = []

    def send(self, goal: Goal) -> ScriptedGoal:
        """Take a goal or request."""
        answer = self._answer(goal.name)
        answer = replace(answer, result={**self._result, **answer.result})
        run = ScriptedGoal(goal, answer, self.clock)
        self.goals.append(run)
        return run

    def publish(self, goal: Goal) -> None:
        """Remember a message."""
        self.published.append(goal)

    def watch(self, topic: str, type_name: str) -> ScriptedInbox:
        """Open an inbox."""
        inbox = ScriptedInbox()
        self._inboxes.append((topic, inbox))
        return inbox

    def log(self, level: str, text: str) -> None:
        """Remember a line."""
        self.logged.append((level, text))

    def give_feedback(self, kind: Kind, values: Mapping[str, float], reason: str) -> ScriptedGoal:
        """Remember feedback; it is taken unless the service of this name answers otherwise."""
        self.feedback_given.append(GivenFeedback(kind=kind, values=values, reason=reason))
        fields: dict[str, Plain] = {"kind": int(kind), "values": values, "reason": reason}
        goal = Goal(kind=BindingKind.SERVICE, name=GIVE_FEEDBACK, type="", fields=fields)
        return ScriptedGoal(goal, self._answer(GIVE_FEEDBACK), self.clock)

    def arrive(self, topic: str, message: Mapping[str, Plain]) -> None:
        """Let a message arrive in the open inboxes of a topic."""
        for name, inbox in self._inboxes:
            if name == topic and not inbox.closed:
                inbox.messages.append(message)

    def running(self) -> list[str]:
        """Return the names of the goals that have not ended."""
        return [run.goal.name for run in self.goals if not run.state.ended]

    def _answer(self, name: str) -> Answer:
        queue = self._answers.get(name) or deque([Answer()])
        return queue.popleft() if len(queue) > 1 else queue[0]
