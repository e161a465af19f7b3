# SPDX-License-Identifier: Apache-2.0
"""Ticks trees when it is time, by plain calls, and reports nodes that have changed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.light_behaviour import INVALID, RUNNING, LightBehaviour

Tick = Callable[[], Status]
"""Ticks one node and its descendants; returns the node's status."""

OnChange = Callable[[Behaviour], None]
"""Receives a node whose status, message or values have changed, or that has acted again."""

OnVisit = Callable[[Behaviour, Status], None]
"""Receives each node that was ticked, with its status."""

WrapLeaf = Callable[[Tick, Behaviour], Tick]
"""Takes the tick of a leaf and the leaf; returns the tick to use instead."""


REST_S = 0.002
"""Shortest time between the end of a tick and an extra one [s]."""


class CallTicked(LightBehaviour):
    """A composite or decorator that is ticked by plain calls instead of py_trees generators."""

    def tick_children(self, ticker: Ticker) -> Status:
        """Tick or reset the children; return the status of this node.

        No child may be RUNNING when this node is not.
        """
        raise NotImplementedError

    def update(self) -> Status:
        return self.status

    def tick(self) -> Iterator[Behaviour]:
        """Tick for tools of py_trees; yield the ticked nodes."""
        visited: list[Behaviour] = []
        Ticker(self, on_visit=lambda node, _: visited.append(node)).tick()
        yield from visited

    def stop(self, new_status: Status) -> None:
        if new_status is INVALID:
            for child in self.children:
                if child.status is not INVALID:
                    child.stop(INVALID)
        self.status = new_status


@dataclass(slots=True)
class LastReport:
    """Last reported status and message of a node; INVALID before the first report.

    It keeps the node alive, because reports are found by ``id()``.
    """

    node: Behaviour
    status: Status = INVALID
    message: str = ""

    @property
    def outdated(self) -> bool:
        """True if the node has changed since; the message of an INVALID node does not count."""
        node = self.node
        return node.status is not self.status or (
            node.feedback_message != self.message and node.status is not INVALID
        )


class Ticker:
    """Ticks a tree of :class:`CallTicked` nodes and leaves like ``root.tick_once()``.

    A leaf is any behaviour without children. Its ``initialise``, ``update`` and ``terminate`` are
    called as in py_trees; its ``update`` must not return INVALID.

    Args:
        on_change: Called once per changed node after each of its ticks: ticked nodes in order of
            their answers, then stopped nodes in tree order. Nodes with ``has_side_effects`` are
            reported at every end, those with ``changes_values`` at every end with other values.
        wrap_leaf: Wraps the tick of each leaf.

    Attributes:
        ticks: Node → its tick, created on first use.
        pending: Roots of subtrees whose statuses may have changed without a tick.
    """

    def __init__(
        self,
        root: Behaviour,
        *,
        on_change: OnChange | None = None,
        on_visit: OnVisit | None = None,
        wrap_leaf: WrapLeaf | None = None,
    ) -> None:
        self.root = root
        self.ticks = _Ticks(self._tick_of)
        self.pending: list[Behaviour] = []
        self._on_change = on_change
        self._on_visit = on_visit
        self._wrap_leaf = wrap_leaf
        self._reports: dict[int, LastReport] = {}
        self._places: dict[int, int] = {}
        self._tick = self.ticks[root]

    def tick(self) -> Status:
        """Tick the tree once; return its status.

        Raises:
            Exception: A leaf raised it; some changes are then never reported.
        """
        status = self._tick()
        if self.pending:
            self._report_pending()
        return status

    def halt(self) -> None:
        """Stop the tree."""
        self.root.stop(INVALID)
        self.pending[:] = [self.root]
        self._report_pending()

    def tick_child(self, node: Behaviour) -> Status:
        """Tick a descendant of the node that is being ticked; return its status."""
        return self.ticks[node]()

    def replace_tick(self, node: Behaviour, tick: Tick) -> None:
        """Replace the tick of a node, from its next tick on."""
        self.ticks[node] = tick
        if node is self.root:
            self._tick = tick

    def report_visits(self, on_visit: OnVisit | None) -> None:
        """Report visits to another listener from the next tick on; None stops that.

        This undoes :meth:`replace_tick`.
        """
        self._on_visit = on_visit
        self.ticks.clear()
        self._tick = self.ticks[self.root]

    def reset_child(self, node: Behaviour) -> None:
        """Stop a descendant of the node that is being ticked, unless it is already INVALID."""
        if node.status is not INVALID:
            node.stop(INVALID)
        self.pending.append(node)

    def last_report(self, node: Behaviour) -> LastReport:
        """Return the last report of a node."""
        return self._reports.setdefault(id(node), LastReport(node))

    def report_if_changed(self, last: LastReport, *, again: bool = False) -> None:
        """Report a node if it has changed since its last report; with ``again`` always."""
        node = last.node
        if again or last.outdated:
            last.status, last.message = node.status, node.feedback_message
            assert self._on_change is not None
            self._on_change(node)
        elif node.status is not INVALID:
            # An equal text in another string; later comparisons by identity use this one.
            last.message = node.feedback_message

    def _tick_of(self, node: Behaviour) -> Tick:
        """Return the tick of a node with everything around it."""
        last = None if self._on_change is None else self.last_report(node)
        make = _call_tick if isinstance(node, CallTicked) else _leaf_tick
        if last is not None and getattr(node, "has_side_effects", False):
            tick = _reported_ends(make(node, self, None), last, self)
        elif last is not None and getattr(node, "changes_values", False):
            tick = _reported_values(make(node, self, last), last, self)
        else:
            tick = make(node, self, last)
        if self._wrap_leaf is not None and not node.children:
            tick = self._wrap_leaf(tick, node)
        return tick if self._on_visit is None else _visited(tick, node, self._on_visit)

    def _report_pending(self) -> None:
        if self._on_change is not None:
            found: list[Behaviour] = []
            for node in self.pending:
                self._find_changed(node, found)
            if len(self.pending) > 1 and len(found) > 1:
                found.sort(key=self._place)
            for node in found:
                self.report_if_changed(self.last_report(node))
        self.pending.clear()

    def _find_changed(self, node: Behaviour, found: list[Behaviour]) -> None:
        """Find the changed nodes of a subtree, children before their parents."""
        last = self._reports.get(id(node))
        if last is None or (last.status is INVALID and node.status is INVALID):
            return
        for child in node.children:
            self._find_changed(child, found)
        if last.outdated:
            found.append(node)

    def _place(self, node: Behaviour) -> int:
        """Return the position of a node in tree order."""
        if not self._places:
            self._places = {id(node): place for place, node in enumerate(self.root.iterate())}
        return self._places[id(node)]


class _Ticks(dict[Behaviour, Tick]):
    """Node → its tick, created on first use."""

    def __init__(self, make: Callable[[Behaviour], Tick]) -> None:
        self._make = make

    def __missing__(self, node: Behaviour) -> Tick:
        tick = self[node] = self._make(node)
        return tick


# Changes are detected inside the tick: a call around each tick would cost a third of it.


def _call_tick(node: Any, ticker: Ticker, last: LastReport | None) -> Tick:
    tick_children, report_if_changed = node.tick_children, ticker.report_if_changed

    def tick() -> Status:
        status: Status = tick_children(ticker)
        node.status = status
        if last is not None and (
            status is not last.status or node.feedback_message is not last.message
        ):
            report_if_changed(last)
        return status

    return tick


def _leaf_tick(node: Behaviour, ticker: Ticker, last: LastReport | None) -> Tick:
    initialise, update, terminate = _own(node, "initialise"), node.update, _own(node, "terminate")
    report_if_changed = ticker.report_if_changed

    def tick() -> Status:
        if initialise is not None and node.status is not RUNNING:
            initialise()
        status: Status = update()
        if terminate is not None and status is not RUNNING:
            terminate(status)
        node.status = status
        if last is not None and (
            status is not last.status or node.feedback_message is not last.message
        ):
            report_if_changed(last)
        return status

    return tick


def _reported_ends(tick: Tick, last: LastReport, ticker: Ticker) -> Tick:
    report_if_changed = ticker.report_if_changed

    def reported() -> Status:
        status = tick()
        report_if_changed(last, again=status is not RUNNING)
        return status

    return reported


def _reported_values(tick: Tick, last: LastReport, ticker: Ticker) -> Tick:
    node: Any = last.node
    report_if_changed = ticker.report_if_changed

    def reported() -> Status:
        status = tick()
        if node.changed and status is not RUNNING:
            # A report of its status has taken its values with it.
            report_if_changed(last, again=True)
        return status

    return reported


def _own(node: Behaviour, name: str) -> Any:
    """Return a method of a node; None if its class does not override it."""
    return None if getattr(type(node), name) is getattr(Behaviour, name) else getattr(node, name)


def _visited(tick: Tick, node: Behaviour, on_visit: OnVisit) -> Tick:
    def visited() -> Status:
        status = tick()
        on_visit(node, status)
        return status

    return visited


class TickScheduler:
    """Schedule of the next tick; the first is due at once. All times are steady [s].

    Regular ticks stay on a grid of periods; missed ones are skipped. An extra tick follows after a
    rest as long as the last tick, so a flood of messages uses at most half of the time.

    Attributes:
        due: When the next tick is due.
    """

    def __init__(self, period_s: float, now: float) -> None:
        self.due = now
        self._period_s = period_s
        self._grid = now
        self._rested = now
        self._requested = False

    def change(self, period_s: float, now: float) -> None:
        """Change the period from now on."""
        self._period_s = period_s
        self._grid = now + period_s
        self.due = min(self.due, self._grid)

    def request(self, now: float) -> None:
        """Request a tick as soon as the rest is over, because something has arrived."""
        self._requested = True
        self.due = min(self.due, max(now, self._rested))

    def now(self, now: float) -> None:
        """Request a tick at once, without a rest."""
        self.due = min(self.due, now)

    def started(self) -> None:
        """Handle the start of a tick, which answers all previous requests."""
        self._requested = False

    def finished(self, began: float, now: float, latest: float = math.inf) -> None:
        """Handle the end of a tick; ``latest`` is when time alone next ends something."""
        self._rested = now + max(now - began, REST_S)
        if now >= self._grid:
            missed = math.floor((now - self._grid) / self._period_s)
            self._grid += (missed + 1) * self._period_s
        self.due = min(self._grid, max(latest, now))
        if self._requested:
            # A request during the tick may concern a node that was already ticked.
            self.due = min(self.due, self._rested)
