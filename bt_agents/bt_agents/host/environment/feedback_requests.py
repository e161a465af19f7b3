# SPDX-License-Identifier: Apache-2.0
"""Feedback of trees: awaited briefly, resent until the feedback node has answered."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from bt_agents.engine.environment import GIVE_FEEDBACK, GoalState
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_core.scene import SceneSpace
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.srv import GiveFeedback
from bt_agents_ros import qos
from bt_agents_ros.outbox import Outbox

WAIT_S = 1.0
"""Longest wait of a leaf for the feedback node's answer [s]."""

STORED = "stored: the feedback node is away and gets it when it is back"
"""Message of feedback without an answer so far."""


class FeedbackRequests:
    """Feedback requests of running trees; none is lost while the feedback node is away.

    Arguments as in ``RosEnvironment``; an answer that a leaf may wait for wakes the host.
    """

    def __init__(
        self,
        node: Node,
        wake: Callable[[], None],
        *,
        run_goal: Callable[[], RunAgent.Goal | None],
        space: SceneSpace,
    ) -> None:
        self._node = node
        self._wake = wake
        self._run_goal = run_goal
        self._space = space
        client = node.create_client(GiveFeedback, GIVE_FEEDBACK, qos_profile=qos.SERVICE)
        self.outbox = Outbox(node, client)

    def give(self, kind: FeedbackKind, values: Mapping[str, float], reason: str) -> FeedbackRun:
        """Request a change of a profile; see :meth:`Environment.give_feedback`."""
        direct, goal = kind is FeedbackKind.DIRECT, self._run_goal()
        assert goal is not None, "only the tree of a run gives feedback"
        request = GiveFeedback.Request(
            feedback_id=f"tree/{uuid.uuid4()}",
            agent=goal.agent,
            kind=int(kind),
            values=self._space.profiles.ordered(values) if direct else (),
            source="tree",
            reason=reason,
            scene=goal.scene,
        )
        run = FeedbackRun()
        self.outbox.put(request, lambda answer: self._handle_answer(run, request, answer))
        return run

    def _handle_answer(self, run: FeedbackRun, request: Any, answer: Any | None) -> None:
        if answer is None:
            return  # the outbox has logged it
        waited_for = not run.state.ended
        run.handle_answer(answer)
        if waited_for:
            self._wake()
        elif not answer.accepted:
            self._node.get_logger().warning(
                f"late feedback of {request.agent} refused: {answer.code}: {answer.message}"
            )


class FeedbackRun:
    """Feedback that was sent; its leaf succeeds after :data:`WAIT_S`, but delivery continues."""

    feedback: Mapping[str, Plain] | None = None
    """None, because a service has no feedback."""

    confirmed = True
    """Always True: it cannot be orphaned, so a run need not wait for it."""

    def __init__(self) -> None:
        self.message = ""
        self.result: Mapping[str, Plain] = {}
        self._state = GoalState.ACTIVE
        self._wait_until = time.monotonic() + WAIT_S

    @property
    def state(self) -> GoalState:
        """Its current state; reading it checks the wait against the clock."""
        if not self._state.ended and time.monotonic() >= self._wait_until:
            self._end(GoalState.SUCCEEDED, STORED)
        return self._state

    def handle_answer(self, answer: Any) -> None:
        """Handle the feedback node's answer."""
        if answer.accepted:
            self._end(GoalState.SUCCEEDED)
        else:
            self._end(GoalState.REJECTED, answer.message or answer.code)

    def cancel(self) -> None:
        """Stop waiting for the answer; the feedback stays valid."""
        self._end(GoalState.CANCELLED, "its answer is not waited for")

    def _end(self, state: GoalState, message: str = "") -> None:
        if not self._state.ended:
            self._state = state
            self.message = message
