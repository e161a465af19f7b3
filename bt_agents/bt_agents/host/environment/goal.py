# SPDX-License-Identifier: Apache-2.0
"""Goals of actions and requests of services over rclpy: state machine, clients, deadlines."""

from __future__ import annotations

import math
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from action_msgs.msg import GoalInfo, GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.node import Node

from bt_agents.engine.environment import (
    Clock,
    GoalState,
    SkillGoal,
    no_acceptance,
    no_result,
    result_limit_s,
    server_missing,
)
from bt_agents.host.environment.open_goal_list import OpenGoalList
from bt_agents_core.field_types import BindingKind, Plain
from bt_agents_core.open_goals import OpenGoal
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.types import MessageView

SECOND_POLL_S = 0.02
"""Time between the poll that first misses a heartbeat and the one that decides it is lost [s].

After a stall, a process handles its timers before the messages that arrived meanwhile.
"""

MOST_UNCONFIRMED = 100
"""Most given-up goals that are remembered; beyond it, the oldest are abandoned."""

GRAPH_S = 0.25
"""Time between two looks at the graph while a goal is open [s]."""

REPEAT_FACTOR = 1.5
"""Factor of the pauses after which a server that has joined is asked again, from :data:`GRAPH_S`.

A server that appears on the graph may not be matched yet, which takes seconds on a busy machine;
until then a request or its answer is lost.
"""

LATE_S = 2.0
"""Time within which a second server accepts a goal, if at all [s]."""

TURN_S = 2.0
"""Longest wait for the end of an earlier goal of the same server before the next one is sent [s].

Many servers take one goal at a time and need some time to stop.
"""

_SEARCH_S = 0.02
_SHORTEST_S = 0.001

_UNKNOWN = "its server knows nothing of the goal any more; was it started anew?"

_WAITS = "its server has not ended the goal before yet"
_OVERTOOK = f"its server had not ended the goal before after {TURN_S:g} s"

_ENDS = {
    GoalStatus.STATUS_SUCCEEDED: GoalState.SUCCEEDED,
    GoalStatus.STATUS_CANCELED: GoalState.CANCELLED,
    GoalStatus.STATUS_ABORTED: GoalState.ABORTED,
}


class GoalTrack:
    """State machine of one goal of an action, or of one request of a service.

    The client reports what the server does: :meth:`sent`, :meth:`accepted`, :meth:`ended` and so
    on. :meth:`poll` compares this with the clock. A goal that has ended stays ended for the leaf;
    later events only confirm that the server has ended it too. The attributes are those of
    :class:`bt_agents.engine.environment.GoalRun`.

    =================== ==================================== ============================
    state               event                                next state
    =================== ==================================== ============================
    PENDING, not sent   no server in time                    UNREACHABLE, confirmed
    PENDING, not sent   an earlier goal is ending            the same, for a bounded time
    PENDING, not sent   cancel                               CANCELLED, confirmed
    PENDING             accepted                             ACTIVE
    PENDING             rejected                             REJECTED, confirmed; of several
                                                             servers only the first has answered
    PENDING             no acceptance in time                UNREACHABLE
    PENDING             a server has joined                  the same, and it is sent again
    ACTIVE              result                               as it says, confirmed as above
    ACTIVE              no result in time                    TIMED_OUT
    ACTIVE              no heartbeat, server not on graph    UNREACHABLE
    ACTIVE              unknown to a server that has joined  UNREACHABLE
    ACTIVE              cancel, unknown to its server        UNREACHABLE
    PENDING, ACTIVE     cancel of an action                  the same until its server answers
    PENDING, ACTIVE     cancel of a service                  CANCELLED, confirmed
    =================== ==================================== ============================

    Args:
        last_heartbeat: Returns the time of the server's last heartbeat [s], minus infinity for
            none so far; None for a server without heartbeats.
        on_end: Called with state and message when the goal has ended for its leaf.
        obstacle: Returns what the graph shows instead of the server; empty for nothing.
    """

    def __init__(
        self,
        goal: SkillGoal,
        steady: Clock,
        last_heartbeat: Callable[[], float] | None = None,
        on_end: Callable[[GoalState, str], None] = lambda _state, _message: None,
        obstacle: Callable[[], str] = lambda: "",
    ) -> None:
        self.state = GoalState.PENDING
        self.message = ""
        self.confirmed = False
        self._kind = goal.kind
        self._timeouts = goal.timeouts
        self._within_s = goal.heartbeat.within_s if goal.heartbeat is not None else math.inf
        self._heartbeat_topic = goal.heartbeat.topic if goal.heartbeat is not None else ""
        self._steady = steady
        self._last_heartbeat = last_heartbeat
        self._on_end = on_end
        self._obstacle = obstacle
        self._made_at = steady()
        self._waits_since: float | None = None
        self._sent_at: float | None = None
        self._asked_at = 0.0
        self._accepted_at: float | None = None
        self._seen_at = 0.0
        self._silent_since: float | None = None
        self._cancel_asked = False
        self._cancel_sent = False
        self._is_given_up = False
        self._servers: frozenset[str] = frozenset()
        self._look_at = 0.0
        self._repeat_at = math.inf
        self._repeat_s = GRAPH_S

    @property
    def unsent(self) -> bool:
        """True while it waits for the discovery of its server."""
        return self._sent_at is None and not self.state.ended

    @property
    def is_ending(self) -> bool:
        """True from its cancel, or its end for the leaf, until its end is certain or given up."""
        over = self._cancel_asked or self.state.ended
        return over and self._sent_at is not None and not (self.confirmed or self._is_given_up)

    @property
    def accepted_by(self) -> float:
        """When the last of several servers has accepted it, if at all, steady time [s]."""
        return self._asked_at + LATE_S

    def take_turn(self, earlier: bool) -> bool:
        """Return whether to send it now that its server is available.

        Args:
            earlier: Whether an earlier goal of the server is ending.
        """
        now = self._steady()
        if not earlier:
            self.message = ""
            return True
        if self._waits_since is None:
            self._waits_since = now
        # Its server is available, so the time limit of the discovery restarts.
        self._made_at = now
        overtakes = now >= self._waits_since + TURN_S
        self.message = _OVERTOOK if overtakes else _WAITS
        return overtakes

    def note(self, text: str) -> None:
        """Set a message about its server while it is open."""
        if text and not self.state.ended:
            self.message = text

    def sent(self, servers: frozenset[str] = frozenset()) -> None:
        """Handle the sending, to the servers that the graph shows.

        A service accepts every request.
        """
        self._sent_at = self._asked_at = self._steady()
        self._servers = servers
        if len(servers) > 1:
            self._repeat_at = self._sent_at
        self._look_at = self._sent_at + GRAPH_S
        if self._kind is not BindingKind.ACTION:
            self.accepted()

    def accepted(self) -> None:
        """Handle its acceptance, which may arrive after it was given up."""
        self._accepted_at = self._seen_at = self._steady()
        if not self.state.ended:
            self.state = GoalState.ACTIVE

    def ended(self, state: GoalState, message: str = "", alone: bool = True) -> None:
        """Handle its end at its only server (``alone``) or at the first of several.

        It may have been given up before.
        """
        self._end(state, message)
        self.confirmed = self.confirmed or alone

    def pursued(self, certain: bool) -> None:
        """Handle the end of its pursuit; later goals no longer wait for it."""
        self.confirmed = self.confirmed or certain
        self._is_given_up = True

    def lost(self, message: str) -> None:
        """Handle the loss of its server's answer; the goal itself may still run."""
        self._give_up(GoalState.UNREACHABLE, message)

    def cancel(self) -> None:
        """Request its end."""
        self._cancel_asked = True
        if self.state.ended:
            return
        if self._sent_at is None:
            self.ended(GoalState.CANCELLED, "stopped before it was sent")
        elif self._kind is not BindingKind.ACTION:
            self.ended(GoalState.CANCELLED, "stopped before the answer")

    def take_cancel(self) -> bool:
        """Return whether to send a cancel to the server now; True only once."""
        due = (
            self._accepted_at is not None
            and not self.confirmed
            and not self._cancel_sent
            and (self._cancel_asked or self.state.ended)
        )
        self._cancel_sent = self._cancel_sent or due
        return due

    def take_look(self) -> bool:
        """Return whether to look for servers now; True once per :data:`GRAPH_S`."""
        now = self._steady()
        due = self._sent_at is not None and not self.state.ended and now >= self._look_at
        if due:
            self._look_at = now + GRAPH_S
        return due

    def take_repeat(self, servers: frozenset[str]) -> bool:
        """Return whether to ask again now, given all servers that the graph shows.

        A server that has joined may be the next start of the one that was asked: the graph shows a
        killed server until its lease ends, and the heartbeat continues. Before acceptance the goal
        is sent again, which no server accepts twice. After acceptance the result is requested
        again, and the answer shows whether the goal is unknown. If the graph shows several servers
        at once, one of them may be dead and another one new.
        """
        now = self._steady()
        if not servers <= self._servers:
            self._repeat_at, self._repeat_s = now, GRAPH_S
        self._servers |= servers
        if now < self._repeat_at:
            return False
        if self._accepted_at is None:
            self._asked_at = now
        self._repeat_at = now + self._repeat_s
        self._repeat_s *= REPEAT_FACTOR
        return True

    def poll(self, server_there: bool) -> None:
        """Check its deadlines, and whether its server is on the graph."""
        if self.state.ended:
            return
        now, timeouts = self._steady(), self._timeouts
        if self._sent_at is None:
            if now >= self._made_at + timeouts.server_s:
                reasons = (server_missing(timeouts.server_s), self._obstacle())
                self.ended(GoalState.UNREACHABLE, "; ".join(filter(None, reasons)))
        elif self._accepted_at is None:
            if now >= self._sent_at + timeouts.accept_s:
                self._give_up(GoalState.UNREACHABLE, no_acceptance(timeouts.accept_s))
        else:
            self._poll_server(now, self._accepted_at, server_there)

    @property
    def due(self) -> float:
        """When to poll again at the latest, on the steady clock [s]; infinite for never."""
        if self.state.ended:
            return math.inf
        if self._sent_at is None:
            return self._steady() + _SEARCH_S
        if self._accepted_at is None:
            return min(self._sent_at + self._timeouts.accept_s, self._steady() + GRAPH_S)
        heartbeat_by = self._last_sign_of_life(self._accepted_at) + self._within_s
        if self._silent_since is not None:
            heartbeat_by = self._silent_since + SECOND_POLL_S
        answered_by = self._accepted_at + result_limit_s(self._kind, self._timeouts)
        return min(heartbeat_by, answered_by, self._steady() + GRAPH_S)

    def _poll_server(self, now: float, accepted_at: float, server_there: bool) -> None:
        limit_s = result_limit_s(self._kind, self._timeouts)
        if now >= accepted_at + limit_s:
            self._give_up(GoalState.TIMED_OUT, no_result(self._kind, limit_s))
            return
        silent_s = now - self._last_sign_of_life(accepted_at)
        if silent_s < self._within_s:
            self._silent_since = None
        elif self._silent_since is None:
            self._silent_since = now
        elif now >= self._silent_since + SECOND_POLL_S:
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
        text = f"no heartbeat for {silent_s:.1f} s"
        if self._last_heartbeat is not None and self._last_heartbeat() == -math.inf:
            text += f", nor ever one on {self._heartbeat_topic}"
        return f"its server has gone silent ({text})"

    def _last_sign_of_life(self, accepted_at: float) -> float:
        if self._last_heartbeat is None:
            return accepted_at
        return max(accepted_at, self._last_heartbeat())

    def _give_up(self, state: GoalState, message: str) -> None:
        self._end(state, message)
        # A request cannot be stopped; a goal may still run.
        self.confirmed = self.confirmed or self._kind is not BindingKind.ACTION

    def _end(self, state: GoalState, message: str = "") -> None:
        if not self.state.ended:
            self.state = state
            self.message = message
            self._on_end(state, message)


@dataclass(frozen=True, kw_only=True)
class Servers:
    """Servers of an action, as the graph shows them.

    Attributes:
        participants: Their participants.
        several: Whether there is more than one; one of them may be dead.
        note: Remark about this for people; empty for none.
    """

    participants: frozenset[str] = frozenset()
    several: bool = False
    note: str = ""


class TrackedGoal:
    """A goal or request with its :class:`GoalTrack`; sends it when its server appears.

    Reading its state polls the server and the clock. It calls ``reschedule`` when its deadline may
    have changed, and ``wake`` when it has ended for its leaf or its end is confirmed.
    """

    def __init__(
        self,
        client: Any,
        message: Any,
        track: GoalTrack,
        *,
        reschedule: Callable[[], None],
        wake: Callable[[], None],
    ) -> None:
        self.client = client
        self._message = message
        self._track = track
        self._reschedule = reschedule
        self._wake = wake
        self._result: Mapping[str, Plain] = {}
        self._feedback: Mapping[str, Plain] | None = None
        self._futures: list[Any] = []
        self.poll()

    @property
    def state(self) -> GoalState:
        self.poll()
        return self._track.state

    @property
    def confirmed(self) -> bool:
        return self._track.confirmed

    @property
    def message(self) -> str:
        return self._track.message

    @property
    def result(self) -> Mapping[str, Plain]:
        return self._result

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        return self._feedback

    @property
    def is_ending(self) -> bool:
        """True while its server may still work on it although its leaf is done with it."""
        return self._track.is_ending

    def cancel(self) -> None:
        with self._transition():
            self._track.cancel()

    @property
    def due(self) -> float:
        """When to poll again at the latest, on the steady clock [s]; infinite for never."""
        return self._track.due

    def abandon(self) -> None:
        """Discard every later answer of its server."""
        for future in self._futures:
            if not future.done():
                future.cancel()

    def poll(self) -> None:
        """Check its deadlines, and send it as soon as its server is available."""
        if self._track.state.ended:
            return
        there = self._server_ready()
        with self._transition():
            if there and self._track.unsent and self._track.take_turn(self._is_behind()):
                self._try_to_send()
            self._track.poll(there)

    def _try_to_send(self) -> None:
        try:
            future = self._send()
        except Exception as error:
            self._track.ended(GoalState.UNREACHABLE, f"it cannot be sent: {error}")
        else:
            self._track.sent(self._servers())
            self._expect(future, self._answered)

    @contextmanager
    def _transition(self) -> Iterator[None]:
        """Follow up a transition of the track in the block: send a cancel, reschedule, wake."""
        before = (self._track.state.ended, self._track.confirmed)
        yield
        self._follow_up()
        self._reschedule()
        if (self._track.state.ended, self._track.confirmed) != before:
            self._wake()

    def _server_ready(self) -> bool:
        raise NotImplementedError

    def _is_behind(self) -> bool:
        """Return whether an earlier goal of its server is ending; always False for requests."""
        return False

    def _servers(self) -> frozenset[str]:
        """Return its servers on the graph; empty if it is sent only once."""
        return frozenset()

    def _send(self) -> Any:
        """Send it; return the future of the answer."""
        raise NotImplementedError

    def _answered(self, answer: Any) -> None:
        raise NotImplementedError

    def _follow_up(self) -> None:
        """Act on a new state."""
        raise NotImplementedError

    def _expect(self, future: Any, then: Callable[[Any], None]) -> None:
        """Handle an answer when it arrives, possibly after the goal was given up."""
        self._futures.append(future)

        def handle(future: Any) -> None:
            if future not in self._futures or future.cancelled():
                return
            self._futures.remove(future)
            with self._transition():
                error = future.exception()
                if error is not None:
                    self._track.lost(f"its answer cannot be read: {error}")
                else:
                    then(future.result())

        future.add_done_callback(handle)


class RosGoalRun(TrackedGoal):
    """A goal of an action; see :class:`TrackedGoal`.

    The list of open goals contains it from before it is sent until its end is confirmed. It may
    subscribe to feedback, and warns when its server refuses a cancel.

    Args:
        servers: Looks up the servers of the action.
        earlier_is_ending: Returns whether an earlier goal of the client is ending.
        pursue: :meth:`GoalCanceller.cancel` with a time limit; for a given-up goal, whose server
            (or its next start, or each of several servers) may still work on it.
    """

    def __init__(
        self,
        client: Any,
        message: Any,
        track: GoalTrack,
        *,
        reschedule: Callable[[], None],
        wake: Callable[[], None],
        identity: OpenGoal,
        open_goals: OpenGoalList,
        servers: Callable[[], Servers],
        earlier_is_ending: Callable[[], bool],
        pursue: Callable[..., None],
        feedback: bool,
        warn: Callable[[str], None],
    ) -> None:
        self._handle: Any = None
        self._identity = identity
        self._open_goals = open_goals
        self._find_servers = servers
        self._found = Servers()
        self._earlier_is_ending = earlier_is_ending
        self._pursue = pursue
        self._is_pursued = False
        self._wants_feedback = feedback
        self._warn = warn
        super().__init__(client, message, track, reschedule=reschedule, wake=wake)

    def _server_ready(self) -> bool:
        return bool(self.client.server_is_ready())

    def _is_behind(self) -> bool:
        return self._earlier_is_ending()

    def _servers(self) -> frozenset[str]:
        self._found = self._find_servers()
        self._track.note(self._found.note)
        return self._found.participants

    def _feedback_callback(self) -> Callable[[Any], None] | None:
        """Return a callback without a strong reference: rclpy keeps it if a goal is rejected."""
        known = weakref.WeakMethod(self._store_feedback)

        def handle(message: Any) -> None:
            store = known()
            if store is not None:
                store(message)

        return handle if self._wants_feedback else None

    def _send(self) -> Any:
        goal_id = GoalInfo().goal_id
        goal_id.uuid = list(self._identity.goal_id)
        self._open_goals.add(self._identity)
        return self.client.send_goal_async(
            self._message, feedback_callback=self._feedback_callback(), goal_uuid=goal_id
        )

    def poll(self) -> None:
        super().poll()
        if not (self._track.take_look() and self._track.take_repeat(self._servers())):
            return
        if self._handle is None:
            self._expect(self._send(), self._answered)
        else:
            self._expect(self._handle.get_result_async(), self._ended)

    def abandon(self) -> None:
        super().abandon()
        self._open_goals.remove(self._identity.goal_id)

    def _follow_up(self) -> None:
        if self._track.confirmed:
            self._open_goals.remove(self._identity.goal_id)
        elif self._track.state.ended and not self._is_pursued:
            self._is_pursued = True
            accepted_by = self._track.accepted_by if self._found.several else None
            self._pursue([self._identity], accepted_by=accepted_by, on_end=self._pursued)
        if self._track.take_cancel():
            self._expect(self._handle.cancel_goal_async(), self._cancel_answered)

    def _answered(self, handle: Any) -> None:
        if self._handle is not None:
            return  # a server accepts a repeated goal only once
        if not handle.accepted:
            alone = not self._found.several
            self._track.ended(GoalState.REJECTED, self._track.message, alone)
            return
        self._handle = handle
        self._track.accepted()
        self._expect(handle.get_result_async(), self._ended)

    def _pursued(self, unconfirmed: tuple[OpenGoal, ...]) -> None:
        with self._transition():
            self._track.pursued(certain=not unconfirmed)

    def _cancel_answered(self, response: Any) -> None:
        if response.return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID:
            self._track.lost(_UNKNOWN)
            return
        over = response.return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
        if not response.goals_canceling and not over and not self._track.confirmed:
            self._warn(f"the server refuses to stop (code {response.return_code})")

    def _ended(self, response: Any) -> None:
        state = _ENDS.get(response.status)
        if state is None:
            self._track.lost(_UNKNOWN)
            return
        self._result = MessageView(response.result)
        self._track.ended(state, alone=not self._found.several)

    def _store_feedback(self, message: Any) -> None:
        """Store feedback for the leaf."""
        if not self._track.state.ended:
            self._feedback = MessageView(message.feedback)
            self._wake()


class RosRequest(TrackedGoal):
    """A request of a service."""

    def abandon(self) -> None:
        for future in self._futures:
            self.client.remove_pending_request(future)
        self._futures.clear()

    def _server_ready(self) -> bool:
        return bool(self.client.service_is_ready())

    def _send(self) -> Any:
        return self.client.call_async(self._message)

    def _follow_up(self) -> None:
        if self._track.state.ended:
            self.abandon()

    def _answered(self, response: Any) -> None:
        if not self._track.state.ended:
            self._result = MessageView(response)
            self._track.ended(GoalState.SUCCEEDED)


class GoalDeadlines:
    """One steady timer for the earliest deadline of all open goals."""

    def __init__(self, node: Node) -> None:
        self._open: list[TrackedGoal] = []
        self._unconfirmed: deque[TrackedGoal] = deque()
        self._timer = steady_timer(node, 1.0, self._poll, running=False)

    def add(self, goal: TrackedGoal) -> None:
        """Track a goal from now on."""
        self._open.append(goal)
        self.reschedule()

    def clients(self) -> list[Any]:
        """Return the clients of all goals whose end is not confirmed."""
        self._drop_confirmed()
        return [goal.client for goal in (*self._open, *self._unconfirmed)]

    def is_ending(self, client: Any) -> bool:
        """Return whether a goal of a client is ending."""
        goals = (*self._open, *self._unconfirmed)
        return any(goal.client is client and goal.is_ending for goal in goals)

    def reschedule(self) -> None:
        """Set the timer to the earliest deadline."""
        self._drop_confirmed()
        due = min((goal.due for goal in self._open), default=math.inf)
        if due == math.inf:
            self._timer.cancel()
            return
        self._timer.timer_period_ns = int(max(due - time.monotonic(), _SHORTEST_S) * 1e9)
        self._timer.reset()

    def _poll(self) -> None:
        for goal in list(self._open):
            goal.poll()
        self.reschedule()

    def _drop_confirmed(self) -> None:
        self._unconfirmed.extend(goal for goal in self._open if goal.due == math.inf)
        self._open = [goal for goal in self._open if goal.due < math.inf]
        self._unconfirmed = deque(goal for goal in self._unconfirmed if not goal.confirmed)
        while len(self._unconfirmed) > MOST_UNCONFIRMED:
            self._unconfirmed.popleft().abandon()
