# SPDX-License-Identifier: Apache-2.0
"""Publishes the recordings of runs while there are subscribers."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from bt_agents.engine.environment import Environment
from bt_agents.engine.run import Run
from bt_agents.recording.recorded_run import RecordingRun
from bt_agents_interfaces.msg import RunRecord, TreeStatus
from bt_agents_language.model.specs import AgentSpec
from bt_agents_ros import qos
from bt_agents_ros.messages import header_at
from bt_agents_ros.timers import steady_timer

_MOST_CHARACTERS = 8_000
"""Characters of lines per message; fewer after :data:`_WAIT_S`."""

_WAIT_S = 0.5
"""Longest time for which lines are collected [s]; a killed host loses them."""

_SEED_BITS = 53


class RunRecords:
    """Publishes recordings on ``~/records``, several steps per message.

    A run is recorded if both the records and the status of trees have subscribers when it begins:
    a recording alone can be replayed, but not compared with what happened.
    """

    def __init__(
        self,
        node: Node,
        instance: str,
        status: Publisher[TreeStatus],
        version: Callable[[str], int],
    ) -> None:
        self._node = node
        self._instance = instance
        self._status = status
        self._version = version
        self._host = str(node.get_fully_qualified_name())
        self._records = node.create_publisher(RunRecord, "~/records", qos.EVENTS)
        self._timer = steady_timer(node, _WAIT_S, self.flush, running=False)
        self._goal: Any = None
        self._tick = 0
        self._lines: list[str] = []
        self._characters = 0

    def run(self, goal: Any, spec: AgentSpec, *, environment: Environment, **how: Any) -> Run:
        """Return the run of a goal, recorded if there are subscribers; see :class:`Run`."""
        if not self._has_subscribers():
            return Run(spec, environment=environment, host=self._host, **how)
        self.flush()
        self._goal = goal
        seed = secrets.randbits(_SEED_BITS)
        return RecordingRun(
            spec,
            environment=environment,
            seed=seed,
            version=self._version(spec.name),
            sink=self._collect,
            host=self._host,
            **how,
        )

    def flush(self) -> None:
        """Publish the collected lines."""
        self._timer.cancel()
        if not self._lines:
            return
        lines, self._lines = self._lines, []
        self._characters = 0
        self._records.publish(
            RunRecord(
                header=header_at(self._node.get_clock().now().to_msg()),
                host=self._host,
                host_instance=self._instance,
                epoch=self._goal.epoch,
                round=self._goal.round,
                agent=self._goal.agent,
                tick=self._tick,
                record="\n".join(lines),
            )
        )

    def _has_subscribers(self) -> bool:
        return bool(
            self._records.get_subscription_count() and self._status.get_subscription_count()
        )

    def _collect(self, tick: int, line: str) -> None:
        if not self._lines:
            self._tick = tick
            self._timer.reset()
        self._lines.append(line)
        self._characters += len(line)
        if self._characters >= _MOST_CHARACTERS:
            self.flush()
