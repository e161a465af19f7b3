# SPDX-License-Identifier: Apache-2.0
"""Looks at goals when their time is up: no tick has to come first, no server has to answer."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection
from typing import Any, Protocol

from rclpy.node import Node

from bt_agents.engine.environment import Clock as SteadyClock
from bt_agents_language.model.specs import HeartbeatSpec
from bt_agents_ros import qos
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.types import load_type

MOST_UNCONFIRMED = 100
"""Goals that were given up and are still remembered; of more the oldest are forgotten."""

_SHORTEST_S = 0.001


class WatchedGoal(Protocol):
    """A goal or request on its way.

    Attributes:
        client: By which it is sent, cancelled and answered.
    """

    client: Any

    def look(self) -> None:
        """Compare it with the clock."""

    @property
    def confirmed(self) -> bool:
        """True when its server surely does nothing for it any more."""

    @property
    def due(self) -> float:
        """When to look again at the latest, on the steady clock [s]; infinite once ended."""

    def forget(self) -> None:
        """Wait for no word of its server any more."""


class GoalDeadlines:
    """Keeps the goals that are under way, and one steady timer for the first that is due.

    Args:
        node: The host's node.
        steady: A clock that never stands still [s].
    """

    def __init__(self, node: Node, steady: SteadyClock) -> None:
        self._steady = steady
        self._under_way: list[WatchedGoal] = []
        self._unconfirmed: deque[WatchedGoal] = deque()
        self._timer = steady_timer(node, 1.0, self._look, running=False)

    def add(self, goal: WatchedGoal) -> None:
        """Look after a goal from now on."""
        self._under_way.append(goal)
        self.rearm()

    def clients(self) -> list[Any]:
        """Return the clients of all goals whose end is not confirmed."""
        self._sort_out()
        return [goal.client for goal in (*self._under_way, *self._unconfirmed)]

    def rearm(self) -> None:
        """Set the timer to the first goal that is due, after something has changed."""
        self._sort_out()
        due = min((goal.due for goal in self._under_way), default=math.inf)
        if due == math.inf:
            self._timer.cancel()
            return
        self._timer.timer_period_ns = int(max(due - self._steady(), _SHORTEST_S) * 1e9)
        self._timer.reset()

    def _look(self) -> None:
        for goal in list(self._under_way):
            goal.look()
        self.rearm()

    def _sort_out(self) -> None:
        self._unconfirmed.extend(goal for goal in self._under_way if goal.due == math.inf)
        self._under_way = [goal for goal in self._under_way if goal.due < math.inf]
        self._unconfirmed = deque(goal for goal in self._unconfirmed if not goal.confirmed)
        while len(self._unconfirmed) > MOST_UNCONFIRMED:
            self._unconfirmed.popleft().forget()


class Heartbeats:
    """Hears servers that publish something for as long as they are alive.

    Args:
        node: The host's node.
        steady: A clock that never stands still [s].
    """

    def __init__(self, node: Node, steady: SteadyClock) -> None:
        self._node = node
        self._steady = steady
        self._last: dict[tuple[str, str], float] = {}
        self._subscriptions: dict[tuple[str, str], Any] = {}

    def listen(self, spec: HeartbeatSpec) -> Callable[[], float]:
        """Return what says when it was last heard [s], minus infinity for never.

        Raises:
            Refused: ``UNKNOWN_TYPE``.
        """
        key = (spec.topic, spec.type)
        if key not in self._subscriptions:
            kind = load_type(spec.type)

            def beat(_message: object) -> None:
                self._last[key] = self._steady()

            # Its content does not matter, so it is not even decoded.
            self._subscriptions[key] = self._node.create_subscription(
                kind, spec.topic, beat, qos.SENSOR, raw=True
            )
        return lambda: self._last.get(key, -math.inf)

    def keep(self, wanted: Collection[tuple[str, str]]) -> None:
        """Stop listening to all others than these topics, each with its type."""
        for key in self._subscriptions.keys() - set(wanted):
            self._node.destroy_subscription(self._subscriptions.pop(key))
            self._last.pop(key, None)
