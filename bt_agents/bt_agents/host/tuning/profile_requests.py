# SPDX-License-Identifier: Apache-2.0
"""Has the feedback node record profiles that were tuned; kept until it has done so."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from bt_agents.engine.environment import GIVE_FEEDBACK
from bt_agents.host.agent_registry import AgentRegistry
from bt_agents.host.tuning.pending_profiles import ProfileOrders
from bt_agents_core.feedback import TUNING, FeedbackKind
from bt_agents_core.scene import Vector
from bt_agents_interfaces.srv import GiveFeedback
from bt_agents_ros import qos
from bt_agents_ros.outbox import Outbox
from bt_agents_ros.timers import steady_timer

_AGAIN_S = 1.0
_UNKNOWN = "UNKNOWN_AGENT"


class ProfileRequests:
    """Sends one request an agent at a time; what is tuned meanwhile is one request after it.

    Args:
        node: The host's node.
        roster: Its agents.
        recorded: Called when the feedback node has taken or refused a profile, with the name of
            the agent and the recorded ``Feedback``, or None.
    """

    def __init__(
        self, node: Node, roster: AgentRegistry, recorded: Callable[[str, Any | None], None]
    ) -> None:
        self._node = node
        self._roster = roster
        self._recorded = recorded
        self._orders = ProfileOrders()
        self._outbox = Outbox(
            node, node.create_client(GiveFeedback, GIVE_FEEDBACK, qos_profile=qos.SERVICE)
        )
        self._again = steady_timer(node, _AGAIN_S, self._send_again, running=False)

    def want(self, agent: str, values: Mapping[str, float], reason: str) -> None:
        """Note values that were tuned, by scene parameter; :meth:`send` has them recorded."""
        self._orders.want(agent, values, reason)

    def over(self, agent: str, profile: Vector) -> Vector:
        """Return a profile with the values that are wanted and not recorded yet."""
        return self._orders.over(agent, self._roster.space.names, profile)

    def forget(self, agent: str) -> None:
        """Want nothing more for an agent that is gone."""
        self._orders.forget(agent)

    def close(self) -> None:
        """Send no more; say what is lost."""
        self._outbox.close()
        if not self._again.is_canceled():
            self._node.get_logger().error(
                "the feedback node did not know these agents, so that their profiles that were "
                f"tuned are lost with this process: {', '.join(self._orders.agents)}"
            )

    def send(self, agent: str) -> None:
        """Send what is wanted for an agent, unless a request of it is under way."""
        order = self._orders.next(agent)
        if order is None:
            return
        request = GiveFeedback.Request(
            feedback_id=f"tuning/{uuid.uuid4()}",
            agent=agent,
            kind=int(FeedbackKind.SET),
            values=list(order.vector(self._roster.space.names)),
            source=TUNING,
            reason=order.reason,
        )
        self._outbox.put(request, lambda answer: self._answered(agent, answer))

    def _answered(self, agent: str, answer: Any | None) -> None:
        if agent not in self._roster.members:
            self._orders.forget(agent)
            return
        if answer is not None and answer.code == _UNKNOWN:
            self._orders.again(agent)
            self._node.get_logger().warning(
                f"the feedback node does not know {agent} yet; the profile that was tuned is "
                "recorded when it does",
                throttle_duration_sec=60.0,
            )
            if self._again.is_canceled():
                self._again.reset()
            return
        self._orders.done(agent)
        accepted = answer is not None and answer.accepted
        if answer is not None and not accepted:
            self._node.get_logger().error(
                f"the feedback node does not record the profile that was tuned, so that {agent} "
                f"has it until the next feedback only: {answer.code}: {answer.message}"
            )
        self._recorded(agent, answer.feedback if answer is not None and accepted else None)
        self.send(agent)

    def _send_again(self) -> None:
        self._again.cancel()
        for agent in self._orders.agents:
            self.send(agent)
