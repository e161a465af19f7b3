# SPDX-License-Identifier: Apache-2.0
"""A host's entry at the market: made when a market shows up, and made again when it is lost."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from bt_agents.ros import qos
from bt_agents.ros.calls import Calls
from bt_agents.ros.run_server import RunServer
from bt_agents.roster import Roster
from bt_agents_interfaces.msg import MarketStatus
from bt_agents_interfaces.srv import RegisterHost

_LIMIT_S = 2.0
_AGAIN_S = 1.0


class Membership:
    """Registers the agents of a host, and opens its action only while the market has them.

    Args:
        node: The host's node.
        roster: Its agents.
        runs: Its action.
        instance: This start of the host.
        changed: Called after the market has taken or refused agents.

    Attributes:
        epoch: The market that has answered last; empty before the first.
    """

    def __init__(
        self,
        node: Node,
        roster: Roster,
        runs: RunServer,
        instance: str,
        changed: Callable[[], None],
    ) -> None:
        self.epoch = ""
        self._node = node
        self._roster = roster
        self._runs = runs
        self._instance = instance
        self._changed = changed
        self._registering = False
        self._calls = Calls(node)
        self._client = node.create_client(
            RegisterHost, "marketplace/register", qos_profile=qos.SERVICE
        )
        node.create_subscription(MarketStatus, "market", self._meet, qos.FACT)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_AGAIN_S, self._again, clock=steady)

    @property
    def complete(self) -> bool:
        """True when the market has taken every agent of this host."""
        return bool(self.epoch) and all(m.agent_id for m in self._roster.members.values())

    def _meet(self, status: MarketStatus) -> None:
        if status.epoch != self.epoch:
            self._register(status.epoch)

    def _again(self) -> None:
        if self.epoch and any(member.refusal for member in self._roster.members.values()):
            self._register(self.epoch)

    def _register(self, epoch: str) -> None:
        if self._registering:
            return
        self._registering = True
        host = str(self._node.get_fully_qualified_name())
        names = list(self._roster.members)
        request = RegisterHost.Request(
            host=host,
            host_instance=self._instance,
            # Actions are not remapped by rclpy, so neither is the name that the market is told.
            run_action=f"{host}/run",
            heartbeat=self._node.resolve_topic_name("~/heartbeat"),
            parameters=list(self._roster.space.names),
            agents=names,
        )
        self._calls.call(
            self._client,
            request,
            deadline_s=_LIMIT_S,
            on_answer=lambda answer: self._answered(names, answer),
            on_failure=lambda reason: self._unanswered(epoch, reason),
        )

    def _answered(self, names: list[str], answer: RegisterHost.Response) -> None:
        self._registering = False
        if not answer.accepted:
            if self.epoch != answer.epoch:
                self._node.get_logger().error(f"the market refuses this host: {answer.message}")
            self.epoch = answer.epoch
            self._runs.close()
            refused = [answer.message] * len(names)
            self._enrol(names, [0] * len(names), refused)
            return
        self.epoch = answer.epoch
        self._runs.open()
        self._runs.end_orphan(answer.epoch)
        self._enrol(names, answer.agent_ids, answer.reasons)

    def _unanswered(self, epoch: str, reason: str) -> None:
        self._registering = False
        self._node.get_logger().warning(f"registration at market {epoch}: {reason}; trying again")
        self._register(epoch)

    def _enrol(self, names: Sequence[str], ids: Sequence[int], reasons: Sequence[str]) -> None:
        before = {n: (m.agent_id, m.refusal) for n, m in self._roster.members.items()}
        if not len(names) == len(ids) == len(reasons):
            self._node.get_logger().error("the market's answer to the registration is malformed")
            return
        self._roster.enrol(names, ids, reasons)
        after = {n: (m.agent_id, m.refusal) for n, m in self._roster.members.items()}
        for name, (_, refusal) in after.items():
            if refusal and refusal != before[name][1]:
                self._node.get_logger().error(f"agent '{name}' is not registered: {refusal}")
        if after != before:
            self._changed()
