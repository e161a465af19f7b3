# SPDX-License-Identifier: Apache-2.0
"""Subscription of a host to the live scene, for its trees."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.live_scene_view import LiveSceneView
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_from_msg
from bt_agents_ros.parameters import declare_live_lease


class LiveScene:
    """The live scene of the run under way."""

    def __init__(self, node: Node, space: SceneSpace) -> None:
        self._node = node
        self._space = space
        self._view: LiveSceneView | None = None
        self._lease_s = declare_live_lease(node, self._set_lease)
        node.create_subscription(SceneMsg, "scene/live", self._on_live_scene, qos.SENSOR)

    def begin_run(self, awarded: Scene) -> Callable[[], Scene]:
        """Begin with the scene of a run; return a function that returns it as it is now."""
        self._view = LiveSceneView(awarded, time.monotonic, self._lease_s)
        return self._view.now

    def _set_lease(self, seconds: float) -> None:
        self._lease_s = seconds
        if self._view is not None:
            self._view.lease_s = seconds

    def _on_live_scene(self, message: SceneMsg) -> None:
        view = self._view
        if view is None or message.scene_id != view.scene_id:
            return
        try:
            view.receive(scene_from_msg(message, self._space))
        except Refused as refused:
            self._node.get_logger().warning(
                f"live scene refused: {refused}", throttle_duration_sec=5.0
            )
