# SPDX-License-Identifier: Apache-2.0
"""A host's messages without a host: ``status_source.py AGENTS NODES RATE`` ticks the first agent.

It prints one line of JSON per second: the time when each tick has published its changes
[s since 1970].
"""

from __future__ import annotations

import json
import sys
import time

import rclpy
from builtin_interfaces.msg import Time
from rclpy.node import Node
from std_msgs.msg import Header

from bare import EVENTS, LATCHED, executor, spin
from bt_agents_interfaces.msg import (
    AgentCard,
    Heartbeat,
    HostCard,
    Run,
    Scene,
    StatusChange,
    Tree,
    TreeNode,
    Trees,
    TreeStatus,
)

HOST = "/agents"
PROBE = "tree/0.sequence/0.say"
"""Node that fails regularly, with the time in its message."""

GROUP = 10
"""Nodes of each part of a tree."""

CHANGES = 8
"""Nodes that change in each tick, besides the probe."""

_PROBE_TICKS = 4


def tree_of(agent: str, nodes: int) -> Tree:
    """Return a tree of groups, each with its leaves."""
    found = [("tree", -1, "selector", "everything")]
    for group in range((nodes - 1) // GROUP):
        path = f"tree/{group}.sequence"
        parent = len(found)
        found.append((path, 0, "sequence", f"group {group}"))
        found += [
            (f"{path}/{leaf}.say", parent, "say", f"sentence {group} {leaf} to somebody")
            for leaf in range(GROUP - 1)
        ]
    return Tree(
        agent=agent,
        nodes=[
            TreeNode(path=path, parent=parent, kind=kind, name=name, file="a.yaml", line=1)
            for path, parent, kind, name in found
        ],
    )


class StatusSource(Node):
    """Publishes cards and trees once, and the changes of each tick."""

    def __init__(self, agents: int, nodes: int, rate_hz: float) -> None:
        super().__init__("agents", enable_rosout=False)
        names = [f"agent_{index:02d}" for index in range(agents)]
        trees = [tree_of(name, nodes) for name in names]
        self._names = {"host": HOST, "host_instance": "one"}
        self._paths = [node.path for node in trees[0].nodes]
        # The studio ignores a host without a heartbeat.
        self._heartbeat = self.create_publisher(Heartbeat, "agents/heartbeat", EVENTS)
        self._latched = [
            self.create_publisher(kind, topic, LATCHED)
            for kind, topic in (
                (HostCard, "bt_agents/cards"),
                (Trees, "agents/trees"),
                (Run, "bt_agents/runs"),
            )
        ]
        cards, shown, runs = self._latched
        cards.publish(HostCard(agents=[AgentCard(name=name) for name in names], **self._names))
        shown.publish(Trees(trees=trees, **self._names))
        run = Run(event=Run.STARTED, scene=Scene(label="benchmark"), agent=names[0], epoch="e")
        run.round, run.header.stamp = 1, self.get_clock().now().to_msg()
        runs.publish(run)
        self._agent = names[0]
        self._status = self.create_publisher(TreeStatus, "agents/status", EVENTS)
        self._tick = 0
        self._ends_s: list[float] = []
        self._period_s = 1 / rate_hz
        self._due_s = time.monotonic() + self._period_s

    def turn(self, timeout_s: float) -> None:
        """Wait until the next tick is due, and tick."""
        time.sleep(max(min(self._due_s - time.monotonic(), timeout_s), 0.0))
        if time.monotonic() < self._due_s:
            return
        self._status.publish(self._changes())
        self._ends_s.append(time.time())
        self._due_s += self._period_s
        if len(self._ends_s) * self._period_s >= 1:
            print(json.dumps(self._ends_s), flush=True)
            self._ends_s.clear()

    def _changes(self) -> TreeStatus:
        self._tick += 1
        states = (StatusChange.RUNNING, StatusChange.SUCCESS, StatusChange.FAILURE)
        first = self._tick * CHANGES
        changed = [
            StatusChange(
                path=self._paths[1 + (first + index) % (len(self._paths) - 1)],
                name="sentence",
                status=states[(self._tick + index) % len(states)],
            )
            for index in range(CHANGES)
        ]
        changes = [one for one in changed if one.path != PROBE]
        if self._tick % _PROBE_TICKS == 0:
            failed = self._tick % (2 * _PROBE_TICKS) == 0
            state = StatusChange.FAILURE if failed else StatusChange.RUNNING
            probe = StatusChange(path=PROBE, name="probe", status=state)
            probe.message = f"{time.time():.6f}" if failed else ""
            changes.append(probe)
        now = time.time_ns()
        return TreeStatus(
            header=Header(stamp=Time(sec=now // 10**9, nanosec=now % 10**9)),
            epoch="e",
            round=1,
            agent=self._agent,
            host_instance="one",
            tick=self._tick,
            tip=PROBE,
            changes=changes,
        )


class _Turner:
    """Spins a source between its ticks, as an executor does."""

    def __init__(self, source: StatusSource) -> None:
        self._source = source
        self._executor = executor()

    def add_node(self, node: Node) -> None:
        self._executor.add_node(node)

    def spin_once(self, timeout_sec: float) -> None:
        self._executor.spin_once(timeout_sec=0.0)
        self._source.turn(timeout_sec)


if __name__ == "__main__":
    rclpy.init()
    made = StatusSource(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
    spin(made, turner=_Turner(made))
