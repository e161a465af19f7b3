# SPDX-License-Identifier: Apache-2.0
"""Order of the events in a tick: as they happened, with the nodes of a branch from the top."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from py_trees.common import Status

from bt_agents.engine.node_errors import LocatedReason
from bt_agents.engine.run import StatusChange
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_tools.rehearsal.events import Event, EventKind


class EventOrder:
    """Sorter that puts the events of each tick of a rehearsal into reading order.

    The nodes by path have parents before children.
    """

    def __init__(self, nodes: Mapping[str, NodeSpec]) -> None:
        self._nodes = nodes
        self._places = {path: place for place, path in enumerate(nodes)}
        self._running: set[str] = set()
        self._declined: set[str] = set()

    def in_order(
        self,
        at_s: float,
        changes: Sequence[StatusChange],
        held: Iterable[tuple[int, Event]],
        failed: str = "",
    ) -> list[Event]:
        """Return the events of a tick at a time [s]: its changes and the held events.

        Each held event has the number of changes before it. A change of a node comes after the
        node's own events, and after the changes of all nodes above it. A node that has ``failed``
        the whole run is not a separate event.
        """
        happened = [*held]
        waits: list[Event] = []
        ticks: list[Event] = []
        for number, change in enumerate(changes):
            if self._is_shown(change):
                ticks.append(Event(at_s=at_s, kind=EventKind.TICK, change=change))
            node = self._nodes.get(change.path)
            if node is None:
                continue
            text = change.message
            if change.status is Status.FAILURE and _gives_up(node, change):
                event = Event(at_s=at_s, kind=EventKind.GIVES_UP, node=node, text=text)
                happened.append((number, event))
            elif self._declines(node, change) and change.path != failed:
                event = Event(at_s=at_s, kind=EventKind.NOT_TAKEN, node=node, text=text)
                happened.append((number, event))
            elif change.status is Status.RUNNING and type_of(node).waits is not None:
                waits.append(Event(at_s=at_s, kind=EventKind.WAITS, node=node, text=text))
        # The sort is stable, so a change comes after the events before it.
        happened.sort(key=lambda pair: pair[0])
        return self._merged([*(event for _, event in happened), *waits], ticks)

    def _declines(self, node: NodeSpec, change: StatusChange) -> bool:
        """Return whether a node now decides against its branch, and has not done so before."""
        if change.status is not Status.FAILURE or not type_of(node).decides:
            self._declined.discard(change.path)
            return False
        known = change.path in self._declined
        self._declined.add(change.path)
        return not known and bool(change.message)

    def _is_shown(self, change: StatusChange) -> bool:
        """Return whether to show a change; one that only resets an ended node is not shown."""
        was_running = change.path in self._running
        if change.status is Status.RUNNING:
            self._running.add(change.path)
        else:
            self._running.discard(change.path)
        return change.status is not Status.INVALID or was_running

    def _merged(self, happened: list[Event], ticks: list[Event]) -> list[Event]:
        merged: list[Event] = []
        merged_until = 0
        for tick in sorted(ticks, key=self._place):
            path = tick.change.path if tick.change is not None else ""
            own = [
                number
                for number, event in enumerate(happened[merged_until:], start=merged_until + 1)
                if event.node is not None and event.node.path == path
            ]
            until = max(own, default=merged_until)
            merged += [*happened[merged_until:until], tick]
            merged_until = until
        return merged + happened[merged_until:]

    def _place(self, tick: Event) -> int:
        return self._places.get(tick.change.path, 0) if tick.change is not None else 0


def _gives_up(node: NodeSpec, change: StatusChange) -> bool:
    """Return whether a failure is an event: a limit, or an error of a leaf."""
    own = isinstance(change.message, LocatedReason) and change.message.path == node.path
    return own and (type_of(node).gives_up or not node.children)
