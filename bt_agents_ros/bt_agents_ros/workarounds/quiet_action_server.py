# SPDX-License-Identifier: Apache-2.0
"""Action server that does not format goal ids for debug lines.

``ActionServer`` of rclpy 7.1.6 formats the id of a goal into half a dozen debug lines per goal,
even if these lines are not logged, and numpy takes 60 µs to format one. No upstream issue is
known; remove this module when rclpy formats these lines only for an enabled debug level.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.action import ActionServer

from bt_agents_core.errors import Refused


class QuietActionServer(ActionServer):
    """rclpy action server with goal ids as arrays that format fast."""

    def take_data(self) -> dict[str, Any]:
        data: dict[str, Any] = super().take_data()
        self.quicken(data)
        return data

    def quicken(self, data: dict[str, Any]) -> None:
        """Replace the goal ids in taken data."""
        for kind in ("goal", "cancel", "result"):
            if kind not in data or isinstance(data[kind][1], Refused):
                continue
            request = data[kind][1]
            _make_quick(request.goal_info.goal_id if kind == "cancel" else request.goal_id)


class _GoalId(np.ndarray):
    def __repr__(self) -> str:
        return self.tobytes().hex()

    def __str__(self) -> str:
        return self.tobytes().hex()

    def __format__(self, _spec: str) -> str:
        return self.tobytes().hex()


def _make_quick(goal_id: Any) -> None:
    # The setter would copy the id into a plain array.
    goal_id._uuid = goal_id.uuid.view(_GoalId)
