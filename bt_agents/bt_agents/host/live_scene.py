# SPDX-License-Identifier: Apache-2.0
"""The live scene of the current run, which becomes stale after a lease without messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from bt_agents_core.liveness import LIVE_LEASE_S
from bt_agents_core.scene import Scene


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
