# SPDX-License-Identifier: Apache-2.0
"""Client of the feedback node, which accepts the steps of other robots."""

from __future__ import annotations

import os

import rclpy
from rclpy.signals import SignalHandlerOptions

from bt_agents_core.errors import BtAgentsError, RefusedElsewhere
from bt_agents_interfaces.srv import ManageProfiles
from bt_agents_ros import qos
from bt_agents_ros.log_files import NO_LOG_FILE
from bt_agents_ros.spinner import Spinner

_FIND_S = 3.0
_ANSWER_S = 30.0
"""Longest time for an answer; an erasure of a person may be running [s]."""


class FeedbackClient:
    """Client of the feedback node of the system on this ROS domain; it connects on demand."""

    def __init__(self) -> None:
        rclpy.init(args=[*NO_LOG_FILE], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(
            "_bt_agents_observer",  # same name as for commands, which DDS security policies know
            namespace=os.environ.get("ROS_NAMESPACE", ""),
            start_parameter_services=False,
        )
        self._spinner = Spinner(self._node)
        self._client = self._node.create_client(
            ManageProfiles, "feedback/manage", qos_profile=qos.SERVICE
        )

    def deliver(self, document: str) -> str:
        """Send a document; return the document of the answer.

        Raises:
            BtAgentsError: There is no answer.
            RefusedElsewhere: The feedback node does not accept it.
        """
        if not self._spinner.spin_until(self._client.service_is_ready, _FIND_S):
            raise BtAgentsError("the feedback node is away; what the others have learned waits")
        request = ManageProfiles.Request(
            action=ManageProfiles.Request.IMPORT, author="fleet", document=document
        )
        future = self._client.call_async(request)
        if not self._spinner.spin_until(future.done, _ANSWER_S):
            self._client.remove_pending_request(future)
            raise BtAgentsError(f"the feedback node has not answered for {_ANSWER_S:g} s")
        answer = future.result()
        if not answer.accepted:
            raise RefusedElsewhere(answer.code, answer.message)
        return str(answer.document)

    def close(self) -> None:
        """Destroy the node and shut ROS down in this process."""
        self._spinner.close()
        rclpy.try_shutdown()
