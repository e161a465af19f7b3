# SPDX-License-Identifier: Apache-2.0
"""Services for operators: commands and previews."""

from __future__ import annotations

import time

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneSpace
from bt_agents_interfaces.srv import OperateMarket, PreviewAuction
from bt_agents_ros import qos
from bt_agents_ros.messages import answering
from marketplace_node.effects import Execute, PreviewEnded
from marketplace_node.market import Market
from marketplace_node.node.messages import auction_to_msg, operator_command_from_msg, scene_or_last


class OperatorServices:
    """Services ``~/operate`` and ``~/preview``; an open preview blocks nothing."""

    def __init__(self, node: Node, market: Market, space: SceneSpace, execute: Execute) -> None:
        self._node = node
        self._market = market
        self._space = space
        self._execute = execute
        self._waiting: dict[int, Future] = {}
        node.create_service(OperateMarket, "~/operate", self._operate, qos_profile=qos.SERVICE)
        node.create_service(
            PreviewAuction,
            "~/preview",
            self._preview,
            qos_profile=qos.SERVICE,
            # In a mutually exclusive group, a waiting request would block the other callbacks.
            callback_group=ReentrantCallbackGroup(),
        )

    def end(self, effect: PreviewEnded) -> None:
        """Answer the request of a preview that has ended."""
        waiting = self._waiting.pop(effect.number, None)
        if waiting is not None:
            waiting.set_result(effect)

    def _operate(
        self, request: OperateMarket.Request, response: OperateMarket.Response
    ) -> OperateMarket.Response:
        with answering(response):
            command = operator_command_from_msg(request, self._space)
            response.message, effects = self._market.operate(command, time.monotonic())
        if response.accepted:
            action = command.action.name.lower()
            self._node.get_logger().info(f"{command.who}, {action}: {response.message}")
            self._execute(effects)
        return response

    async def _preview(
        self, request: PreviewAuction.Request, response: PreviewAuction.Response
    ) -> PreviewAuction.Response:
        with answering(response):
            scene = scene_or_last(request.scene, self._space)
            number, effects = self._market.preview(scene, request.strategy, time.monotonic())
            ended = self._waiting[number] = Future()
            self._execute(effects)
            outcome = (await ended).outcome
            if isinstance(outcome, Refused):
                raise outcome
            response.auction = auction_to_msg(outcome, self._node.get_clock().now().to_msg())
            response.message = outcome.reason
        return response
