# SPDX-License-Identifier: Apache-2.0
"""Client node: it calls the services of a running system."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import rclpy

from bt_agents_ros import qos
from bt_agents_ros.calls import Calls
from bt_agents_ros.node_main import NO_LOG_FILE
from bt_agents_ros.spinner import Spinner, starting_ros
from bt_agents_ros.system_topics import service_called
from bt_agents_ros.types import load_type
from bt_agents_tools.client.printable_messages import make_printable

_NAME = "_bt_agents_observer"
"""Name of the node: hidden, so that 'ros2 param list' does not wait for it."""

_LIMIT_S = 5.0
_LAST_POLL_S = 0.5
_POLL_S = 0.02  # a change of the ROS graph does not wake the executor
_LIMITS_S = {
    "manage": 30.0,  # erasing a person rewrites the whole ledger
    "preview": 70.0,  # more than the longest deadline of a round with an external program
}
"""Longest times for an answer, if not :data:`_LIMIT_S` [s]."""


class SystemClient:
    """Node that calls services of a running system; it handles answers while it spins.

    It makes texts in answers printable, because any process may have sent them.

    Attributes:
        namespace: Namespace of the system, from the environment's ``ROS_NAMESPACE``.
    """

    def __init__(self) -> None:
        namespace = os.environ.get("ROS_NAMESPACE", "")
        with starting_ros(NO_LOG_FILE):
            self.node = rclpy.create_node(
                _NAME, namespace=namespace, start_parameter_services=False
            )
        self.namespace = self.node.get_namespace()
        self._spinner = Spinner(self.node)
        self._calls = Calls(self.node)
        self._clients: dict[str, Any] = {}

    def spin_until(
        self, done: Callable[[], bool], limit_s: float, *, poll_s: float = _POLL_S
    ) -> bool:
        """Spin until ``done()`` or for a limited time; see :meth:`Spinner.spin_until`."""
        return self._spinner.spin_until(done, limit_s, poll_s=poll_s)

    def ask(
        self, service: str, *, find_s: float = 10.0, limit_s: float = 0.0, **fields: Any
    ) -> Any:
        """Call a service; return its response, or None if it is missing or does not answer.

        Args:
            service: Its name.
            find_s: Longest time for discovery of the service [s].
            limit_s: Longest time for the answer [s]; 0 for the default of the service.
            fields: Fields of the request; ``action`` and ``person`` by the names of constants.
        """
        kind = load_type(service_called(service).type)
        for field in fields.keys() & {"action", "person"}:
            fields[field] = getattr(kind.Request, fields[field])
        client = self._client(service)
        if not self.spin_until(client.service_is_ready, find_s):
            return None
        answers: list[Any] = []
        deadline_s = limit_s or _LIMITS_S.get(service.rpartition("/")[2], _LIMIT_S)
        self._calls.call(
            client,
            kind.Request(**fields),
            deadline_s=deadline_s,
            on_answer=answers.append,
            on_failure=lambda _reason: answers.append(None),
        )
        self.spin_until(lambda: bool(answers), deadline_s + _LAST_POLL_S)
        return make_printable(answers[0]) if answers and answers[0] is not None else None

    def _client(self, service: str) -> Any:
        if service not in self._clients:
            kind = load_type(service_called(service).type)
            self._clients[service] = self.node.create_client(
                kind, service, qos_profile=qos.SERVICE
            )
        return self._clients[service]

    def close(self) -> None:
        """Destroy the node and shut ROS down in this process."""
        self._spinner.close()
        rclpy.try_shutdown()
