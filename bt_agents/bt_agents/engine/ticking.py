# SPDX-License-Identifier: Apache-2.0
"""Ticks trees of py_trees behaviours by plain calls, and tells what has changed on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator, EternalGuard

from bt_agents.engine.halting import (
    INVALID,
    RUNNING,
    LastReport,
    Step,
    Stop,
    can_be_keys,
    method_of,
    stop_of,
)
from bt_agents.engine.steps import STEPS, telling

Tell = Callable[[Behaviour], None]
"""Takes a node whose status or message is another than before, or that has acted again."""

Around = Callable[[Step, Behaviour], Step]
"""Takes what ticks a leaf, and the leaf; returns what is to be done instead."""

Visit = Callable[[Behaviour, Status], None]
"""Takes a node that has answered a tick, and how."""


class Ticker:
    """Ticks a tree as py_trees does, without its generators and the words that nobody reads.

    After a tick each node has the status, message and current child that it would have after
    ``root.tick_once()``, and the same methods of the same nodes were called in the same order.
    Only ``iterator``, which py_trees itself never looks at, is not made anew.

    How a node is ticked is decided by the ``tick`` and ``stop`` that it has when it is ticked for
    the first time: those of py_trees and of :class:`CallTicked` are known. A node with one of its
    own is ticked by its generator, and so is everything below it. Its ``initialise`` and
    ``terminate`` are looked up then, too. Which children a node has is seen anew in each tick.

    Args:
        root: The outermost node.
        tell: Called for each node that has changed since it was last told, and for each end of
            one that has ``acts``: first, in the order of the answers, for those that have
            answered; then, in the order of the tree, for those that were stopped. A node that
            somebody else stops is told when it, or one around it, is ticked or stopped again.
        visit: Called for each node that has answered.
        around: What is done around the tick of each leaf; None for nothing. Leaves below a node
            with a ``tick`` of its own are left out.

    Attributes:
        steps, stops, noted, silent: See :class:`bt_agents.engine.halting.Tree`.
    """

    def __init__(
        self,
        root: Behaviour,
        *,
        tell: Tell | None = None,
        visit: Visit | None = None,
        around: Around | None = None,
    ) -> None:
        self.root = root
        self.steps = _Steps(self)
        self.stops = _Stops(self)
        self.noted: list[Behaviour] = []
        self.silent: set[Behaviour] = set()
        self.visit = visit
        self.around = around
        self._tell = tell
        self._told: dict[int, LastReport] = {}
        self._places: dict[int, int] = {}
        self._step = _step_of(root, self)
        self._stop = stop_of(root, self)

    def tick(self) -> Status:
        """Tick the tree once; return its status.

        Raises:
            Exception: What a node raises. Not all that has changed by then is told, then or later.
        """
        status = self._step()
        if self.noted:
            self._look_at_noted()
        return status

    def halt(self) -> None:
        """Stop the tree."""
        self._stop(INVALID)
        self.noted[:] = [self.root]
        self._look_at_noted()

    def tick_child(self, node: Behaviour) -> Status:
        """Tick a node in the course of a :meth:`CallTicked.turn`; return its status."""
        return self.steps[node]()

    def drop_child(self, node: Behaviour) -> None:
        """Leave a node out during a :meth:`CallTicked.turn`: stop it, or forget its end."""
        if node.status is not INVALID:
            self.stops[node](INVALID)
        self.noted.append(node)

    def told(self, node: Behaviour) -> LastReport | None:
        """Return what was last told about a node; None when nothing is to be told."""
        return None if self._tell is None else self._told.setdefault(id(node), LastReport(node))

    def look(self, node: Behaviour, told: LastReport, *, again: bool = False) -> None:
        """Tell a node if it has changed since, or ``again`` in any case."""
        if again or _changed(node, told):
            told.status, told.message = node.status, node.feedback_message
            assert self._tell is not None
            self._tell(node)
        elif node.status is not INVALID:
            # It says the same by another string.
            told.message = node.feedback_message

    def _look_at_noted(self) -> None:
        if self._tell is not None:
            found: list[Behaviour] = []
            for node in self.noted:
                self._find_changed(node, found)
            if len(self.noted) > 1 and len(found) > 1:
                found.sort(key=self._place)
            for node in found:
                self.look(node, self._told[id(node)])
        self.noted.clear()

    def _find_changed(self, node: Behaviour, found: list[Behaviour]) -> None:
        """Find a node and those below it that have changed since they were last told."""
        told = self._told.get(id(node))
        if told is None or (told.status is INVALID and node.status is INVALID):
            return
        for child in node.children:
            self._find_changed(child, found)
        if _changed(node, told):
            found.append(node)

    def _place(self, node: Behaviour) -> int:
        """Return the place of a node in the order of the tree."""
        if id(node) not in self._places:
            self._places = {id(node): place for place, node in enumerate(self.root.iterate())}
        return self._places.get(id(node), -1)


def _changed(node: Behaviour, told: LastReport) -> bool:
    return node.status is not told.status or (
        node.feedback_message != told.message and node.status is not INVALID
    )


class CallTicked(Behaviour):
    """A behaviour that says by plain calls how it and those below it are ticked."""

    def turn(self, tree: Ticker) -> Status:
        """Have each node below ticked or dropped; return the status with which it goes on or ends.

        Its end, by the ``stop`` of its class, is up to the caller.
        """
        raise NotImplementedError

    def update(self) -> Status:
        """Return the status: all is done by :meth:`turn`."""
        return self.status

    def tick(self) -> Iterator[Behaviour]:
        """Tick, for somebody who walks through the tree by the generators of py_trees."""
        visited: list[Behaviour] = []
        Ticker(self, visit=lambda node, _: visited.append(node)).tick()
        yield from visited


class _Steps(dict[Behaviour, Step]):
    """Node → what ticks it, made when it is first looked for."""

    def __init__(self, ticker: Ticker) -> None:
        self._ticker = ticker

    def __missing__(self, node: Behaviour) -> Step:
        step = self[node] = _step_of(node, self._ticker)
        # Made now, so that a cancel is quick.
        self._ticker.stops[node]
        return step


class _Stops(dict[Behaviour, Stop]):
    """Node → what ends it, made when it is first looked for."""

    def __init__(self, ticker: Ticker) -> None:
        self._ticker = ticker

    def __missing__(self, node: Behaviour) -> Stop:
        stop = self[node] = stop_of(node, self._ticker)
        return stop


def _step_of(node: Behaviour, ticker: Ticker) -> Step:
    """Return what ticks a node as its own ``tick`` does, or goes through that."""
    step, visit = _maker_of(node)(node, ticker), ticker.visit
    if ticker.around is not None and not node.children:
        step = ticker.around(step, node)
    if visit is None:
        return step

    def visited() -> Status:
        status = step()
        visit(node, status)
        return status

    return visited


def _maker_of(node: Behaviour) -> Callable[[Any, Ticker], Step]:
    tick, stop = method_of(node, "tick"), method_of(node, "stop")
    if tick is CallTicked.tick:
        return _by_turns
    if tick is EternalGuard.tick and method_of(super(EternalGuard, node), "tick") is not (
        Decorator.tick
    ):
        return _by_generator
    maker, needed = STEPS.get(tick, (_by_generator, None))
    return maker if stop is needed and can_be_keys(node) else _by_generator


def _by_turns(node: CallTicked, ticker: Ticker) -> Step:
    turn, stop, noted = node.turn, ticker.stops[node], ticker.noted

    def step() -> Status:
        status = turn(ticker)
        if status is not RUNNING:
            if status is INVALID:
                noted.extend(node.children)
            stop(status)
        node.status = status
        return status

    return telling(step, node, ticker)


def _by_generator(node: Behaviour, ticker: Ticker) -> Step:
    def step() -> Status:
        for inner in node.tick():
            if inner is node:
                continue
            told = ticker.told(inner)
            if told is not None:
                ticker.look(inner, told)
            if ticker.visit is not None:
                ticker.visit(inner, inner.status)
        # Who has stopped whom is not known.
        ticker.noted.extend(node.iterate())
        return node.status

    return telling(step, node, ticker)
