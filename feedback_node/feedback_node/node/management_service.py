# SPDX-License-Identifier: Apache-2.0
"""Service for managing learned profiles."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_interfaces.srv import ManageProfiles
from bt_agents_ros import qos
from feedback_node.management.management import Management, ManagementCommand, ManagementResult


class ManagementService:
    """Server of ``~/manage``.

    Args:
        node: The feedback node.
        management: Executes the requests.
        on_done: Called with each result, before the response goes out.
    """

    def __init__(
        self, node: Node, management: Management, on_done: Callable[[ManagementResult], None]
    ) -> None:
        self._management = management
        self._on_done = on_done
        node.create_service(ManageProfiles, "~/manage", self._handle, qos_profile=qos.SERVICE)

    def _handle(
        self, request: ManageProfiles.Request, response: ManageProfiles.Response
    ) -> ManageProfiles.Response:
        command = ManagementCommand(
            action=request.action,
            agent=request.agent,
            layer=request.layer,
            author=request.author,
            reason=request.reason,
            older_s=request.older_s,
            document=request.document,
        )
        try:
            done = self._management.execute(command)
        except Refused as refusal:
            # What a document quotes may hold characters that no message can carry.
            response.code = refusal.code
            response.message = refusal.reason.encode(errors="replace").decode()
            return response
        self._on_done(done)
        response.accepted = True
        response.message, response.document = done.message, done.document
        return response
