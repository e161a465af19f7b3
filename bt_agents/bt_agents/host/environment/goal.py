# SPDX-License-Identifier: Apache-2.0
"""Goals of actions and requests of services over rclpy, which never block a tick."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal

from bt_agents.engine.environment import GoalState
from bt_agents.host.environment.goal_track import GoalTrack
from bt_agents_core.field_types import Plain
from bt_agents_ros.message_view import MessageView

_ENDS = {
    GoalStatus.STATUS_SUCCEEDED: GoalState.SUCCEEDED,
    GoalStatus.STATUS_CANCELED: GoalState.CANCELLED,
    GoalStatus.STATUS_ABORTED: GoalState.ABORTED,
}
_NOTHING: Mapping[str, Plain] = {}


class _Sent:
    """What goals and requests have in common.

    Args:
        client: Client of the action or service.
        message: The goal or request.
        track: Says where it is.
        rearm: Called when it may have to be looked at earlier than before.
        wake: Called when there is news for its leaf, or for the run that waits for its end.

    Attributes:
        client: The same.
    """

    def __init__(
        self,
        client: Any,
        message: Any,
        track: GoalTrack,
        *,
        rearm: Callable[[], None],
        wake: Callable[[], None],
    ) -> None:
        self.client = client
        self._message = message
        self._track = track
        self._rearm = rearm
        self._wake = wake
        self._result = _NOTHING
        self._futures: list[Any] = []
        self.look()

    @property
    def state(self) -> GoalState:
        """Where it is now; looking also notices a server that appeared or a time that is up."""
        self.look()
        return self._track.state

    @property
    def confirmed(self) -> bool:
        """True when its server surely does nothing for it any more."""
        return self._track.confirmed

    @property
    def message(self) -> str:
        """Why it is where it is, in words."""
        return self._track.message

    @property
    def result(self) -> Mapping[str, Plain]:
        """Fields of the result or response."""
        return self._result

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        """Fields of the latest feedback; None for none."""
        return None

    @property
    def due(self) -> float:
        """When to look again at the latest, on the steady clock [s]; infinite for never."""
        return self._track.due

    def forget(self) -> None:
        """Wait for no word of its server any more."""
        for future in self._futures:
            if not future.done():
                future.cancel()

    def look(self) -> None:
        """Compare it with the clock, and send it as soon as its server is there."""
        if self._track.state.ended:
            return
        there = self._there()
        with self._news():
            if there and self._track.unsent:
                self._try_to_send()
            self._track.look(there)

    def _try_to_send(self) -> None:
        try:
            self._send()
        except Exception as error:
            self._track.ended(GoalState.UNREACHABLE, f"it cannot be sent: {error}")

    @contextmanager
    def _news(self) -> Iterator[None]:
        """Draw the conclusions from what happens inside."""
        before = (self._track.state.ended, self._track.confirmed)
        yield
        self._obey()
        self._rearm()
        if (self._track.state.ended, self._track.confirmed) != before:
            self._wake()

    def _there(self) -> bool:
        raise NotImplementedError

    def _send(self) -> None:
        raise NotImplementedError

    def _obey(self) -> None:
        """Do what its new state asks for."""

    def _expect(self, future: Any, then: Callable[[Any], None]) -> None:
        """Go on with an answer when it is there, which may be long after anybody waits for it."""
        self._futures.append(future)

        def answered(future: Any) -> None:
            if future not in self._futures or future.cancelled():
                return
            self._futures.remove(future)
            with self._news():
                error = future.exception()
                if error is not None:
                    self._track.lost(f"its answer cannot be read: {error}")
                else:
                    then(future.result())

        future.add_done_callback(answered)


class RosGoalRun(_Sent):
    """A goal of an action.

    Args:
        client: The action client.
        message: The goal.
        track: Says where it is.
        rearm: As for every goal and request.
        wake: The same.
        feedback: Whether its feedback is listened to.
        warn: Is told in words when the server refuses to stop.
    """

    def __init__(
        self,
        client: Any,
        message: Any,
        track: GoalTrack,
        *,
        rearm: Callable[[], None],
        wake: Callable[[], None],
        feedback: bool,
        warn: Callable[[str], None],
    ) -> None:
        self._handle: Any = None
        self._wants_feedback = feedback
        self._feedback: MessageView | None = None
        self._warn = warn
        super().__init__(client, message, track, rearm=rearm, wake=wake)

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        """Fields of the latest feedback; None for none."""
        return self._feedback

    def cancel(self) -> None:
        """Ask for the end; a goal not accepted yet is cancelled on acceptance."""
        with self._news():
            self._track.cancel()

    def _there(self) -> bool:
        return bool(self.client.server_is_ready())

    def _send(self) -> None:
        listener = _listener(self) if self._wants_feedback else None
        future = self.client.send_goal_async(self._message, feedback_callback=listener)
        self._track.sent()
        self._expect(future, self._answered)

    def _obey(self) -> None:
        if self._track.take_cancel():
            self._expect(self._handle.cancel_goal_async(), self._cancel_answered)

    def _answered(self, handle: Any) -> None:
        if not handle.accepted:
            self._track.rejected()
            return
        self._handle = handle
        self._track.accepted()
        self._expect(handle.get_result_async(), self._ended)

    def _cancel_answered(self, response: Any) -> None:
        over = response.return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
        if not response.goals_canceling and not over and not self._track.confirmed:
            self._warn(f"the server refuses to stop (code {response.return_code})")

    def _ended(self, response: Any) -> None:
        state = _ENDS.get(response.status)
        if state is None:
            self._track.lost("its server knows nothing of the goal any more; was it started anew?")
            return
        self._result = MessageView(response.result)
        self._track.ended(state)

    def hear(self, message: Any) -> None:
        """Take feedback."""
        if not self._track.state.ended:
            self._feedback = MessageView(message.feedback)
            self._wake()


class RosRequest(_Sent):
    """A request of a service."""

    def cancel(self) -> None:
        """Wait for the answer no more."""
        with self._news():
            self._track.cancel()

    def forget(self) -> None:
        """Wait for no answer any more; one that comes is discarded."""
        for future in self._futures:
            self.client.remove_pending_request(future)
        self._futures.clear()

    def _there(self) -> bool:
        return bool(self.client.service_is_ready())

    def _send(self) -> None:
        future = self.client.call_async(self._message)
        self._track.sent()
        self._expect(future, self._answered)

    def _obey(self) -> None:
        if self._track.state.ended:
            self.forget()

    def _answered(self, response: Any) -> None:
        if not self._track.state.ended:
            self._result = MessageView(response)
            self._track.ended(GoalState.SUCCEEDED)


def _listener(goal: RosGoalRun) -> Callable[[Any], None]:
    """Return a callback for feedback, which rclpy keeps for ever when a goal is rejected."""
    known = weakref.ref(goal)

    def hear(message: Any) -> None:
        goal = known()
        if goal is not None:
            goal.hear(message)

    return hear
