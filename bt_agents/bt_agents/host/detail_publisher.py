# SPDX-License-Identifier: Apache-2.0
"""Publishes what the nodes of a running tree read, write and wait for."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from rclpy.node import Node

from bt_agents.engine.countdowns import Countdown, Countdowns
from bt_agents.engine.run import Run
from bt_agents.engine.value_trace import ValueTrace, as_written
from bt_agents.host.run_server import RunServer
from bt_agents_core.field_types import FieldType
from bt_agents_interfaces.msg import Countdown as CountdownMsg
from bt_agents_interfaces.msg import NodeDetails, NodeValue
from bt_agents_ros import qos
from bt_agents_ros.messages import header_at

_MOST_VALUES = 500
"""Most values in one message; the latest are kept."""

_MOST_COUNTDOWNS = 500

_DRIFT_S = 0.05
"""Shift of the end of a countdown on the steady clock after which it is sent again [s]."""


class _WatchedTree:
    """One tree with traced values."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.types = {one.name: one.type for one in run.spec.tunables}
        self.values = ValueTrace(run.root)
        self.countdowns = Countdowns(run.root)
        self.sent: dict[str, tuple[float, int]] | None = None


class DetailPublisher:
    """Publishes on ``~/details`` after ticks that read, wrote or began something.

    Without subscribers, nothing is traced or computed.
    """

    def __init__(self, node: Node, runs: RunServer, instance: str) -> None:
        self._node = node
        self._runs = runs
        self._instance = instance
        self._publisher = node.create_publisher(NodeDetails, "~/details", qos.EVENTS)
        self._wanted = False
        self._tree: _WatchedTree | None = None
        runs.on_control.append(self._on_tick)
        runs.on_tick.append(self._on_tick)
        runs.on_end.append(lambda *_: self._forget())

    def check_subscribers(self) -> None:
        """Check whether there are subscribers; called with each heartbeat."""
        before, self._wanted = self._wanted, self._publisher.get_subscription_count() > 0
        if before == self._wanted:
            return
        if self._wanted:
            self._on_tick()
        elif self._tree is not None:
            self._tree.values.close()
            self._forget()

    def _forget(self) -> None:
        self._tree = None

    def _on_tick(self) -> None:
        run = self._runs.run
        if not self._wanted or run is None:
            return
        if self._tree is None or self._tree.run is not run:
            self._tree = _WatchedTree(run)
        if not run.ticks:
            return
        tree = self._tree
        values = tree.values.take()[-_MOST_VALUES:]
        now = self._runs.environment.clock()
        running = tree.countdowns.running(run.deadlines, now)[:_MOST_COUNTDOWNS]
        ends = {f"{one.path} {one.ends_at is None}": self._end_of(one, now) for one in running}
        if not values and not _differ(ends, tree.sent):
            return
        tree.sent = ends
        goal = self._runs.goal
        self._publisher.publish(
            NodeDetails(
                header=header_at(self._node.get_clock().now().to_msg()),
                epoch=goal.epoch,
                round=goal.round,
                agent=goal.agent,
                host_instance=self._instance,
                tick=run.ticks,
                values=[
                    NodeValue(
                        path=one.path,
                        name=one.name,
                        value=as_written(one.value, tree.types.get(one.name, FieldType.ANY)),
                        written=one.written,
                    )
                    for one in values
                ],
                countdowns=_messages(running, now),
            )
        )

    def _end_of(self, countdown: Countdown, now: float) -> tuple[float, int]:
        """Return when a countdown ends on the steady clock, and the remaining attempts."""
        if countdown.ends_at is None:
            return (0.0, countdown.remaining or 0)
        # For a paused run, the remaining time counts, which does not change.
        base = 0.0 if self._runs.control.paused else time.monotonic()
        return (countdown.ends_at - now + base, 0)


def _differ(ends: dict[str, tuple[float, int]], sent: dict[str, tuple[float, int]] | None) -> bool:
    if sent is None or ends.keys() != sent.keys():
        return True
    return any(
        abs(end - sent[key][0]) > _DRIFT_S or left != sent[key][1]
        for key, (end, left) in ends.items()
    )


def _messages(running: Sequence[Countdown], now: float) -> list[CountdownMsg]:
    return [
        CountdownMsg(
            path=one.path,
            kind=one.kind,
            unit=CountdownMsg.TIME if one.ends_at is not None else CountdownMsg.ATTEMPTS,
            remaining_s=math.nan if one.ends_at is None else one.ends_at - now,
            remaining=one.remaining or 0,
        )
        for one in running
    ]
