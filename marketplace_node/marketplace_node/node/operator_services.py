# SPDX-License-Identifier: Apache-2.0
"""Services of operators, and the file by which their overrides survive a restart."""

from __future__ import annotations

import time
from pathlib import Path

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import Refused
from bt_agents_core.private_files import make_private_file, make_private_folder
from bt_agents_core.scene import SceneSpace
from bt_agents_core.worker_thread import WorkerThread
from bt_agents_interfaces.srv import OperateMarket, PreviewAuction
from bt_agents_ros import qos
from bt_agents_ros.timers import FuturePoller
from marketplace_node.effects import Execute, PreviewEnded
from marketplace_node.market import Market
from marketplace_node.node.messages import auction_to_msg, operator_command_from_msg, scene_or_last


class OperatorServices:
    """Services ``~/operate`` and ``~/preview``; a preview blocks nothing while it is open."""

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
            # While one waits, the callbacks of a group that excludes each other would wait too.
            callback_group=ReentrantCallbackGroup(),
        )

    def end(self, effect: PreviewEnded) -> None:
        """Have the request answered that a preview was for."""
        waiting = self._waiting.pop(effect.number, None)
        if waiting is not None:
            waiting.set_result(effect)

    def _operate(
        self, request: OperateMarket.Request, response: OperateMarket.Response
    ) -> OperateMarket.Response:
        try:
            command = operator_command_from_msg(request, self._space)
            response.message, effects = self._market.operate(command, time.monotonic())
        except Refused as refused:
            response.code, response.message = refused.code, refused.reason
            return response
        response.accepted = True
        action = command.action.name.lower()
        self._node.get_logger().info(f"{command.who}, {action}: {response.message}")
        self._execute(effects)
        return response

    async def _preview(
        self, request: PreviewAuction.Request, response: PreviewAuction.Response
    ) -> PreviewAuction.Response:
        try:
            scene = scene_or_last(request.scene, self._space)
            number, effects = self._market.preview(scene, request.strategy, time.monotonic())
            ended = self._waiting[number] = Future()
            self._execute(effects)
            outcome = (await ended).outcome
            if isinstance(outcome, Refused):
                raise outcome
        except Refused as refused:
            response.code, response.message = refused.code, refused.reason
            return response
        response.accepted = True
        response.auction = auction_to_msg(outcome, self._node.get_clock().now().to_msg())
        response.message = outcome.reason
        return response


class OverridesFile:
    """File that is read once and written, with its folder, by a thread of its own."""

    def __init__(self, node: Node, path: Path) -> None:
        self._node = node
        self._path = path
        self._poller = FuturePoller(node)
        self._worker = WorkerThread("operator overrides")

    def read(self) -> str:
        """Return the stored text; empty when there is none."""
        try:
            return self._path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return ""
        except (OSError, UnicodeDecodeError) as error:
            self._report(str(error))
            return ""

    def store(self, text: str) -> None:
        """Replace the stored text."""
        self._poller.watch(self._worker.submit(self._write, text), self._report)

    def close(self) -> None:
        """Write what still waits to be written."""
        self._worker.shutdown()

    def _write(self, text: str) -> None:
        make_private_folder(self._path.parent)
        make_private_file(self._path)
        write_atomically(self._path, text)

    def _report(self, what: str) -> None:
        if what:
            self._node.get_logger().error(
                f"pins, vetoes and counts are not kept over a restart of the market: {what}"
            )
