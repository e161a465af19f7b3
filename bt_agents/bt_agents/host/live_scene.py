# SPDX-License-Identifier: Apache-2.0
"""The live scene as the trees of a host see it."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.live_scene_view import LEASE_S, LiveSceneView
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_from_msg
from bt_agents_ros.parameters import declare_and_watch, describe

LIVE_LEASE = "live_lease"
"""Parameter of hosts and the feedback node: how long a live scene counts."""


def declare_live_lease(node: Node, changed: Callable[[float], None]) -> float:
    """Declare :data:`LIVE_LEASE`; return its value, and call back for every other one [s]."""
    limits = describe(
        "silence after which the live scene is stale, at least 2 / live_rate [s]",
        minimum=0.1,
        maximum=60.0,
    )
    return float(declare_and_watch(node, LIVE_LEASE, LEASE_S, limits, changed))


class LiveScene:
    """Follows the live scene of the run under way.

    Args:
        node: The host's node.
        space: The scene parameters.
    """

    def __init__(self, node: Node, space: SceneSpace) -> None:
        self._node = node
        self._space = space
        self._view: LiveSceneView | None = None
        self._lease_s = declare_live_lease(node, self._set_lease)
        node.create_subscription(SceneMsg, "scene/live", self._take, qos.SENSOR)

    def follow(self, awarded: Scene) -> Callable[[], Scene]:
        """Begin with the scene of a run; return what tells the scene as it is at each moment."""
        self._view = LiveSceneView(awarded, time.monotonic, self._lease_s)
        return self._view.now

    def _set_lease(self, seconds: float) -> None:
        self._lease_s = seconds
        if self._view is not None:
            self._view.lease_s = seconds

    def _take(self, message: SceneMsg) -> None:
        view = self._view
        if view is None or message.scene_id != view.scene_id:
            return
        try:
            view.see(scene_from_msg(message, self._space))
        except Refused as refused:
            self._node.get_logger().warning(
                f"live scene refused: {refused}", throttle_duration_sec=5.0
            )
