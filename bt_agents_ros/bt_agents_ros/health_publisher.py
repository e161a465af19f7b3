# SPDX-License-Identifier: Apache-2.0
"""Publisher of the health of a node on ``/diagnostics``, for ROS monitors."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from bt_agents_core.health import PartHealth, first_values
from bt_agents_core.liveness import HEARTBEAT_S
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_ros import qos

TOPIC = "/diagnostics"

PERIOD_S = 1.0
"""Time between messages while nothing changes [s]."""

_LONGEST_TEXT = 500


class HealthPublisher:
    """Publishes the health of the parts of a node once a second, and when it changes.

    It has no timer, so that it does not wake an idle node: the node calls :meth:`update` at least
    once a second.

    Args:
        node: Owner of the parts, whose names begin with its name.
        judge: Returns the health of all parts.
        name: Prefix of the names of the parts, by default the name of the node.
    """

    def __init__(
        self, node: Node, judge: Callable[[], Iterable[PartHealth]], name: str = ""
    ) -> None:
        self._node = node
        self._judge = judge
        self._name = f"{node.get_namespace()}/{name or node.get_name()}".lstrip("/")
        self._published: tuple[PartHealth, ...] = ()
        self._statuses: list[DiagnosticStatus] = []
        self._due = 0.0
        self._publisher = node.create_publisher(DiagnosticArray, TOPIC, qos.EVENTS)

    @property
    def is_heard(self) -> bool:
        """Whether anything listens."""
        return bool(self._publisher.get_subscription_count())

    def update(self) -> None:
        """Publish the health if it has changed or a second has passed."""
        parts, now = tuple(self._judge()), time.monotonic()
        if parts == self._published and now < self._due:
            return
        if parts != self._published:
            self._published = parts
            self._statuses = [_status(self._name, part) for part in parts]
        # A caller that calls five times a second, and slightly late, is in time.
        self._due = now + PERIOD_S - HEARTBEAT_S / 2
        message = DiagnosticArray(status=self._statuses)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def _status(node: str, part: PartHealth) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=bytes([part.level]),
        name=f"{node}: {part.part}",
        message=_line(part.message),
        hardware_id=node,
        values=[
            KeyValue(key=_line(key), value=_line(value))
            for key, value in first_values(part.values).items()
        ],
    )


def _line(text: str) -> str:
    return ellipsize(printable_line(text), _LONGEST_TEXT)
