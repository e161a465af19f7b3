# SPDX-License-Identifier: Apache-2.0
"""Service ``~/register``: hosts enter their agents and report runs that are not announced."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneSpace
from bt_agents_interfaces.srv import RegisterHost
from bt_agents_ros import qos
from bt_agents_ros.messages import seconds
from marketplace_node.effects import Effect
from marketplace_node.interaction.market_failover import MAX_RUNS
from marketplace_node.market import Market
from marketplace_node.node.hosts import HostConnections
from marketplace_node.node.messages import earlier_run_from_msg, registration_from_msg

_SHOWN = 200  # characters of what is malformed


class RegistrationService:
    """Service by which hosts register.

    Args:
        node: The marketplace node.
        market: Who is asked.
        hosts: The market's end of the hosts.
        space: The scene parameters.
        execute: Executes the effects that the market answers with.
    """

    def __init__(
        self,
        node: Node,
        market: Market,
        hosts: HostConnections,
        space: SceneSpace,
        execute: Callable[[list[Effect]], None],
    ) -> None:
        self._node = node
        self._market = market
        self._hosts = hosts
        self._space = space
        self._execute = execute
        node.create_service(RegisterHost, "~/register", self._register, qos_profile=qos.SERVICE)

    def _register(
        self, request: RegisterHost.Request, response: RegisterHost.Response
    ) -> RegisterHost.Response:
        registration = registration_from_msg(request)
        answer, effects = self._market.register(registration, time.monotonic())
        self._execute(effects)
        response.epoch = self._market.epoch
        response.accepted = answer.accepted
        response.agent_ids = list(answer.agent_ids)
        response.reasons = list(answer.reasons)
        response.message = answer.message
        if answer.accepted and not self._hosts.reaches(request.host):
            response.accepted = False
            response.agent_ids = [0] * len(request.agents)
            response.message = (
                f"UNREACHABLE: {request.run_action} or {request.heartbeat} cannot be used, "
                "as something else has the name; the log of the marketplace says more"
            )
            response.reasons = [response.message] * len(request.agents)
        if response.accepted:
            self._take_unreported(request)
        else:
            self._node.get_logger().warning(f"host '{request.host}' refused: {response.message}")
        return response

    def _take_unreported(self, request: RegisterHost.Request) -> None:
        """Take the runs of an earlier market as far as they are in order."""
        now_s = seconds(self._node.get_clock().now().to_msg())
        runs = []
        for message in request.unreported[:MAX_RUNS]:
            try:
                runs.append(earlier_run_from_msg(message, self._space, now_s))
            except Refused as refused:
                self._node.get_logger().warning(
                    f"a run that {request.host} had not reported is left out: "
                    f"{str(refused)[:_SHOWN]}"
                )
        if len(request.unreported) > MAX_RUNS:
            self._node.get_logger().warning(
                f"{request.host} hands over {len(request.unreported)} unreported runs, "
                f"the first {MAX_RUNS} are taken"
            )
        self._execute(self._market.unreported(request.host, runs, time.monotonic()))
