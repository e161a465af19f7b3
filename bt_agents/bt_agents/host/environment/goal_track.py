# SPDX-License-Identifier: Apache-2.0
"""Where one goal or request is, decided from what its server says and from the steady clock."""

from __future__ import annotations

import math
from collections.abc import Callable

from bt_agents.engine.environment import Clock, GoalState, SkillGoal
from bt_agents_core.field_types import BindingKind
from bt_agents_language.model.specs import REPLY_LIMIT_S, Timeouts

SECOND_LOOK_S = 0.02
"""A heartbeat that seems lost is waited for so much longer [s].

A process that was held up itself finds its timers before the messages that came meanwhile.
"""

_SEARCH_S = 0.02
_GRAPH_S = 0.25


def server_missing(limit_s: float) -> str:
    """Return that a server was not found in time [s]."""
    return f"its server is not there (looked for {limit_s:g} s)"


def no_acceptance(limit_s: float) -> str:
    """Return that a server did not say in time whether it takes a goal [s]."""
    return f"its server does not answer (no word about the goal for {limit_s:g} s)"


def no_result(kind: BindingKind, limit_s: float) -> str:
    """Return that a goal has no result, or a request no answer, in time [s]."""
    return f"no {'result' if kind is BindingKind.ACTION else 'answer'} within {limit_s:g} s"


def result_limit_s(kind: BindingKind, timeouts: Timeouts) -> float:
    """Return how long the result or answer may take [s]; infinite for no limit."""
    if timeouts.result_s is not None:
        return timeouts.result_s
    return math.inf if kind is BindingKind.ACTION else REPLY_LIMIT_S


class GoalTrack:
    """Follows one goal to an action server, or one request to a service.

    Whoever talks to the server says what happens: :meth:`sent`, :meth:`accepted`, :meth:`ended`
    and so on. :meth:`look` compares that with the clock. What ends once stays ended for the leaf;
    what comes later only confirms that the server has ended it too.

    Args:
        goal: What was asked for.
        steady: A clock that never stands still [s].
        last_beat: Returns when the server's heartbeat was last heard [s], minus infinity for
            never; None where there is no heartbeat.

    Attributes:
        state: Where it is for the leaf.
        message: Why it is there, in words.
        confirmed: See :class:`bt_agents.engine.environment.GoalRun`.
    """

    def __init__(
        self, goal: SkillGoal, steady: Clock, last_beat: Callable[[], float] | None = None
    ) -> None:
        self.state = GoalState.PENDING
        self.message = ""
        self.confirmed = False
        self._kind = goal.kind
        self._timeouts = goal.timeouts
        self._within_s = goal.heartbeat.within_s if goal.heartbeat is not None else math.inf
        self._heartbeat_topic = goal.heartbeat.topic if goal.heartbeat is not None else ""
        self._steady = steady
        self._last_beat = last_beat
        self._made_at = steady()
        self._sent_at: float | None = None
        self._accepted_at: float | None = None
        self._seen_at = 0.0
        self._silent_since: float | None = None
        self._cancel_asked = False
        self._cancel_sent = False

    @property
    def unsent(self) -> bool:
        """True while it waits for its server to be found."""
        return self._sent_at is None and not self.state.ended

    def sent(self) -> None:
        """Note that it is on its way; a service takes every request."""
        self._sent_at = self._steady()
        if self._kind is not BindingKind.ACTION:
            self.accepted()

    def accepted(self) -> None:
        """Note that the server has taken it, maybe after nobody waited for it any more."""
        self._accepted_at = self._seen_at = self._steady()
        if not self.state.ended:
            self.state = GoalState.ACTIVE

    def rejected(self) -> None:
        """Note that the server has not taken it."""
        self._end(GoalState.REJECTED)
        self.confirmed = True

    def ended(self, state: GoalState, message: str = "") -> None:
        """Note the server's word that it has ended, maybe after nobody waited for it any more."""
        self._end(state, message)
        self.confirmed = True

    def lost(self, message: str) -> None:
        """Note that nothing more will be heard of it, though it may go on."""
        self._give_up(GoalState.UNREACHABLE, message)

    def cancel(self) -> None:
        """Ask for the end."""
        self._cancel_asked = True
        if self.state.ended:
            return
        if self._sent_at is None:
            self.ended(GoalState.CANCELLED, "stopped before it was sent")
        elif self._kind is not BindingKind.ACTION:
            self.ended(GoalState.CANCELLED, "stopped before the answer")

    def take_cancel(self) -> bool:
        """Return whether the server has to be told to stop now; True once only."""
        due = (
            self._accepted_at is not None
            and not self.confirmed
            and not self._cancel_sent
            and (self._cancel_asked or self.state.ended)
        )
        self._cancel_sent = self._cancel_sent or due
        return due

    def look(self, server_there: bool) -> None:
        """Compare it with the clock.

        Args:
            server_there: Whether its server is on the graph.
        """
        if self.state.ended:
            return
        now, timeouts = self._steady(), self._timeouts
        if self._sent_at is None:
            if now >= self._made_at + timeouts.server_s:
                self.ended(GoalState.UNREACHABLE, server_missing(timeouts.server_s))
        elif self._accepted_at is None:
            if now >= self._sent_at + timeouts.accept_s:
                self._give_up(GoalState.UNREACHABLE, no_acceptance(timeouts.accept_s))
        else:
            self._look_at_server(now, self._accepted_at, server_there)

    @property
    def due(self) -> float:
        """When to look again at the latest, on the steady clock [s]; infinite for never."""
        if self.state.ended:
            return math.inf
        if self._sent_at is None:
            return self._steady() + _SEARCH_S
        if self._accepted_at is None:
            return self._sent_at + self._timeouts.accept_s
        heard_by = self._heard_at(self._accepted_at) + self._within_s
        if self._silent_since is not None:
            heard_by = self._silent_since + SECOND_LOOK_S
        answered_by = self._accepted_at + result_limit_s(self._kind, self._timeouts)
        return min(heard_by, answered_by, self._steady() + _GRAPH_S)

    def _look_at_server(self, now: float, accepted_at: float, server_there: bool) -> None:
        limit_s = result_limit_s(self._kind, self._timeouts)
        if now >= accepted_at + limit_s:
            self._give_up(GoalState.TIMED_OUT, no_result(self._kind, limit_s))
            return
        silent_s = now - self._heard_at(accepted_at)
        if silent_s < self._within_s:
            self._silent_since = None
        elif self._silent_since is None:
            self._silent_since = now
        elif now >= self._silent_since + SECOND_LOOK_S:
            self._give_up(GoalState.UNREACHABLE, self._silence(silent_s))
            return
        if server_there:
            self._seen_at = now
        elif now >= self._seen_at + self._timeouts.server_s:
            self._give_up(
                GoalState.UNREACHABLE,
                f"its server has left the graph (gone for {self._timeouts.server_s:g} s)",
            )

    def _silence(self, silent_s: float) -> str:
        words = f"no heartbeat for {silent_s:.1f} s"
        if self._last_beat is not None and self._last_beat() == -math.inf:
            words += f", nor ever one on {self._heartbeat_topic}"
        return f"its server has gone silent ({words})"

    def _heard_at(self, accepted_at: float) -> float:
        if self._last_beat is None:
            return accepted_at
        return max(accepted_at, self._last_beat())

    def _give_up(self, state: GoalState, message: str) -> None:
        self._end(state, message)
        # Of a request nothing can be stopped; a goal may go on.
        self.confirmed = self.confirmed or self._kind is not BindingKind.ACTION

    def _end(self, state: GoalState, message: str = "") -> None:
        if not self.state.ended:
            self.state = state
            self.message = message
