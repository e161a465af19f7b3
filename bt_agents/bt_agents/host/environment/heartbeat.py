# SPDX-License-Identifier: Apache-2.0
"""Heartbeats of servers: when each was last received."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from typing import Any

from rclpy.node import Node

from bt_agents_language.model.specs import HeartbeatSpec
from bt_agents_ros import qos
from bt_agents_ros.types import load_type


class Heartbeats:
    """Subscriptions to the heartbeats of servers."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._last: dict[tuple[str, str], float] = {}
        self._subscriptions: dict[tuple[str, str], Any] = {}

    def subscribe(self, spec: HeartbeatSpec) -> Callable[[], float]:
        """Return a function for the time of the last one [s], minus infinity for never.

        Raises:
            Refused: ``UNKNOWN_TYPE``.
        """
        key = (spec.topic, spec.type)
        if key not in self._subscriptions:
            kind = load_type(spec.type)

            def receive(_message: object) -> None:
                self._last[key] = time.monotonic()

            # Its content does not matter, so it is not even decoded.
            self._subscriptions[key] = self._node.create_subscription(
                kind, spec.topic, receive, qos.SENSOR, raw=True
            )
        return lambda: self._last.get(key, -math.inf)

    def retain(self, wanted: Collection[tuple[str, str]]) -> None:
        """Unsubscribe from all others than these topics, each with its type."""
        for key in self._subscriptions.keys() - set(wanted):
            self._node.destroy_subscription(self._subscriptions.pop(key))
            self._last.pop(key, None)
