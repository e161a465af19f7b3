# SPDX-License-Identifier: Apache-2.0
"""The live scene as the trees of a host see it."""

from __future__ import annotations

from rclpy.node import Node

from bt_agents.errors import Refused
from bt_agents.ros import qos
from bt_agents.ros.messages import scene_from_msg
from bt_agents.scene import Scene, SceneSpace
from bt_agents_interfaces.msg import Scene as SceneMsg


class LiveScene:
    """Keeps the latest live scene.

    Args:
        node: The host's node.
        space: The scene parameters.
    """

    def __init__(self, node: Node, space: SceneSpace) -> None:
        self._node = node
        self._space = space
        self._latest: Scene | None = None
        node.create_subscription(SceneMsg, "scene/live", self._take, qos.SENSOR)

    def of(self, scene_id: str) -> Scene | None:
        """Return the latest live scene of a scene id, None when there is none."""
        latest = self._latest
        return latest if latest is not None and latest.scene_id == scene_id else None

    def _take(self, message: SceneMsg) -> None:
        try:
            self._latest = scene_from_msg(message, self._space)
        except Refused as refused:
            self._node.get_logger().warning(
                f"live scene refused: {refused}", throttle_duration_sec=5.0
            )
