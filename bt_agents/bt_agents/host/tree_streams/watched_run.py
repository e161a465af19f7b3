# SPDX-License-Identifier: Apache-2.0
"""Watched runs: data of one run for streams, noted only while there are subscribers."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.run import Run
from bt_agents.engine.value_trace import TracedValue, ValueTrace
from bt_agents.host.tree_streams.blackboard import Activity, BlackboardView, activities
from bt_agents.host.tree_streams.stream import TickStatistics
from bt_agents.host.tree_streams.tree_snapshot import NodeState, ShownNode, TreeSnapshot


class WatchedRun:
    """The current run, or the last one.

    Attributes:
        blackboard: Its names by their keys.
        changed: Whether the last tick changed a status.
        activity: What its nodes read and wrote in the last tick, if noted.
        ticks: Statistics of its ticks since it is watched.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        self.blackboard = BlackboardView(run.scope)
        self.changed = True
        self.activity: list[Activity] = []
        self.ticks = TickStatistics()
        self._snapshot: TreeSnapshot | None = None
        self._noting = False
        self._visits: set[str] = set()
        self._visited: frozenset[str] | None = None
        self._statuses: list[Status] = []
        self._traces: dict[Behaviour, ValueTrace] = {}
        self._known: dict[str, str] = {}

    def note(self, *, visits: bool, activity: bool) -> None:
        """Note which nodes answer, and what they read and write, from the next tick on."""
        if visits != self._noting:
            self._noting = visits
            self._visited = None
            self.run.report_visits(self._visit if visits else None)
            self.ticks = TickStatistics()
        if activity:
            for root in self._roots():
                if root not in self._traces:
                    self._traces[root] = ValueTrace(root, repeated=True)
        elif self._traces:
            for trace in self._traces.values():
                trace.close()
            self._traces.clear()
            self.activity = []

    def take_tick(self, began: float, ended: float) -> None:
        """Take the notes of a tick, with its start and end on the steady clock [s]."""
        self.ticks.add(began, ended)
        statuses = [node.status for root in self._roots() for node in root.iterate()]
        self.changed = statuses != self._statuses
        self._statuses = statuses
        self._visited = frozenset(self._visits)
        self._visits.clear()
        if self._traces:
            traced: list[TracedValue] = []
            for trace in self._traces.values():
                traced += trace.take()
            self.activity = activities(traced, self._known)

    def nodes(self) -> list[tuple[ShownNode, NodeState]]:
        """Return the current state of all nodes, parents before children."""
        snapshot = self._shown()
        return list(zip(snapshot.nodes, snapshot.states(self._active()), strict=True))

    def visited_keys(self) -> list[str]:
        """Return the keys of the nodes that answered in the last tick."""
        active = self._active()
        shown = [node for node in self._shown().nodes if node.path in active]
        return list(dict.fromkeys(key for node in shown for key, _ in node.accesses))

    def _shown(self) -> TreeSnapshot:
        if self._snapshot is None:
            self._snapshot = TreeSnapshot(self.run)
        return self._snapshot

    def _active(self) -> frozenset[str]:
        """Return the paths that answered; if that was not noted, the running ones."""
        if self._visited is not None:
            return self._visited
        return frozenset(
            node.spec.path
            for root in self._roots()
            for node in root.iterate()
            if node.status is Status.RUNNING
        )

    def _roots(self) -> Iterator[Behaviour]:
        yield self.run.root
        if self.run.clean_up is not None:
            yield self.run.clean_up

    def _visit(self, node: Behaviour, _status: Status) -> None:
        self._visits.add(node.spec.path)
