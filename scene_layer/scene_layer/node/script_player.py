# SPDX-License-Identifier: Apache-2.0
"""Player of a script instead of sensors."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from bt_agents_core.scene import Scene
from bt_agents_language.model.specs import Script, Visit
from bt_agents_ros.parameters import declare, describe
from bt_agents_ros.timers import steady_timer
from scene_layer.script import MarketView, ScriptPerformance

_PERIOD_S = 0.02


class ScriptPlayer:
    """Announces the visits of a script and gives their changes.

    Args:
        announce: Announces the scene of a visit, possibly again.
        begin_visit: Called once per visitor, with the name, before the scene is announced.
        listened: Returns whether a market takes scenes.
    """

    def __init__(
        self,
        node: Node,
        script: Script,
        announce: Callable[[Visit], Scene],
        begin_visit: Callable[[str], None],
        give: Callable[[Mapping[str, float], bool | None], object],
        listened: Callable[[], bool],
    ) -> None:
        self._node = node
        self._announce = announce
        self._begin_visit = begin_visit
        self._begun = 0
        self._give = give
        self._listened = listened
        wait_for_agents = declare(
            node,
            "wait_for_agents",
            1,
            describe(
                "number of agents that the market must have before the script begins",
                minimum=0,
                maximum=1_000_000,
                integer=True,
                read_only=True,
            ),
        )
        self._performance = ScriptPerformance(script, wait_for_agents=int(wait_for_agents))
        self._timer = steady_timer(node, _PERIOD_S, self.play)

    def started(self, scene_id: str) -> None:
        """Handle the start of a run."""
        self._performance.started(scene_id, time.monotonic())
        self.play()

    def market(self, message: Any) -> None:
        """Handle the state of the market."""
        self._performance.market(MarketView.of(message), time.monotonic())
        self.play()

    def play(self) -> None:
        """Execute the due steps of the script; called at every event and by a timer."""
        performance = self._performance
        if performance.done:
            return
        now = time.monotonic()
        if performance.over() and performance.done:
            self._timer.cancel()
            self._node.get_logger().info("the script is played to its end")
            return
        if performance.not_taken(now):
            self._node.get_logger().warning("the market did not take the scene; sending it again")
        if performance.visit is None and self._listened():
            visit = performance.next(now)
            if visit is not None:
                self._begin(visit)
        for change in performance.due(now):
            self._give(change.values, change.person)

    def _begin(self, visit: Visit) -> None:
        if self._begun != self._performance.number:
            self._begun = self._performance.number
            self._begin_visit(visit.name)
        scene = self._announce(visit)
        self._performance.announced(scene.scene_id)
        self._node.get_logger().info(f"visit {self._performance.number}: {visit.label}")
