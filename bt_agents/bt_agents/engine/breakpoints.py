# SPDX-License-Identifier: Apache-2.0
"""Breakpoints of a ticked tree: a node answers RUNNING once before it starts."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.light_behaviour import INVALID, RUNNING
from bt_agents.engine.ticker import Tick, Ticker


class Breakpoints:
    """Nodes of one tree that start one tick later than their turn.

    Such a node is RUNNING without having done anything, so the rest of the tick proceeds as with
    any node that has just started. A tree without breakpoints has no overhead.
    """

    def __init__(self, ticker: Ticker) -> None:
        self._kept: list[Any] = []
        self._ticker = ticker
        self._stopping: set[Behaviour] = set()
        # Held at a breakpoint; if their status is no longer RUNNING, they were stopped meanwhile.
        self._waiting: set[Behaviour] = set()
        self._plain: dict[Behaviour, Tick] = {}

    def set(self, paths: Collection[str]) -> None:
        """Set the nodes before which the tree stops, replacing the previous ones.

        A node that is held at its breakpoint stays held until the next tick.
        """
        nodes: dict[Behaviour, Any] = {}
        if paths:
            wanted = frozenset(paths)
            every = self._ticker.root.iterate()
            nodes = {node: node for node in every if _path(node) in wanted}
        self._stopping = set(nodes)
        for node in nodes.keys() - self._plain.keys():
            self._plain[node] = self._ticker.ticks[node]
            self._ticker.replace_tick(node, self._held_tick(node, self._plain[node]))
        for node in self._plain.keys() - nodes.keys() - self._waiting:
            self._ticker.replace_tick(node, self._plain.pop(node))

    def replace_again(self) -> None:
        """Replace the ticks of its nodes again, after the ticker has recreated all ticks."""
        for node in self._plain:
            self._plain[node] = self._ticker.ticks[node]
            self._ticker.replace_tick(node, self._held_tick(node, self._plain[node]))

    @property
    def held(self) -> tuple[str, ...]:
        """Paths of the nodes held since :meth:`begin_tick`, unless stopped in the same tick."""
        return tuple(_path(node) for node in self._kept if node.status is RUNNING)

    def begin_tick(self) -> None:
        """Forget which nodes were held in the previous tick."""
        self._kept.clear()

    def _held_tick(self, node: Any, tick: Tick) -> Tick:
        def held() -> Status:
            waits = node in self._waiting
            self._waiting.discard(node)
            if node.status is RUNNING:
                if waits:
                    # Only a node that is not RUNNING can start.
                    node.status = INVALID
            elif node in self._stopping:
                self._waiting.add(node)
                self._kept.append(node)
                node.status = RUNNING
                self._ticker.report_if_changed(self._ticker.last_report(node))
                return RUNNING
            return tick()

        return held


def _path(node: Any) -> str:
    return str(node.spec.path)
