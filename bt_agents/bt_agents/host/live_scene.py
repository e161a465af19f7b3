# SPDX-License-Identifier: Apache-2.0
"""The live scene of the current run, which becomes stale after a lease without messages."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from rclpy.node import Node

from bt_agents_core.errors import Refused
from bt_agents_core.liveness import LIVE_LEASE_S
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_from_msg
from bt_agents_ros.parameters import declare_live_lease


class LiveScene:
    """The live scene of the current run."""

    def __init__(self, node: Node, space: SceneSpace) -> None:
        self._node = node
        self._space = space
        self._view: LiveSceneView | None = None
        self._lease_s = declare_live_lease(node, self._set_lease)
        node.create_subscription(SceneMsg, "bt_agents/scene/live", self._on_live_scene, qos.SENSOR)

    def begin_run(self, awarded: Scene) -> Callable[[], Scene]:
        """Start with the scene of a run; return a function for its current state."""
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


class LiveSceneView:
    """Latest live scene of one run, initially the awarded one; each counts for ``lease_s`` [s]."""

    def __init__(
        self, awarded: Scene, clock: Callable[[], float], lease_s: float = LIVE_LEASE_S
    ) -> None:
        self.lease_s = lease_s
        self.scene_id = awarded.scene_id
        self._clock = clock
        self._scene = awarded
        self._seen_at = clock()

    def receive(self, scene: Scene) -> None:
        """Take a live scene of the run."""
        self._scene = scene
        self._seen_at = self._clock()

    def now(self) -> Scene:
        """Return the latest scene, marked as stale if none arrived during the lease."""
        silent_s = self._clock() - self._seen_at
        return self._scene if silent_s <= self.lease_s else replace(self._scene, stale_s=silent_s)
