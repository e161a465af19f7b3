# SPDX-License-Identifier: Apache-2.0
"""Wait set that is reused between waits, for :mod:`~bt_agents_ros.workarounds.cached_executor`.

For every wait, rclpy 7.1.6 collects the entities of all nodes, and makes and fills a wait set
(``Executor._wait_for_ready_callbacks``); that is most of the cost of a message hop. There is no
upstream issue: rclpy's answer is ``EventsExecutor``. Remove this module together with our
executor.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.waitable import NumberOfEntities

_EVENTS_S = 2.0
"""Period for polling events of the middleware, such as QoS mismatches [s].

Each publisher and subscription has two, and they are rare.
"""

_POLLS_S = (0.1, 0.3)
"""Shortest and longest time between two polls of polled subscriptions [s].

A node with its own heartbeat polls them when it wakes for that.
"""


_ENTITIES = {
    "timer": "timers",
    "subscription": "subscriptions",
    "guard_condition": "guards",
    "client": "clients",
    "service": "services",
}
"""Kind of entity in wait sets → attribute of a node that lists its own."""


class PolledGroup(MutuallyExclusiveCallbackGroup):
    """Callback group of subscriptions whose messages wake no node and may come 0.3 s late.

    Waking for each heartbeat is most of the work of an idle node. Do not use the group for
    heartbeats that also report ongoing work: they would be handled after later events.
    """


class CachedWaitSet:
    """Wait set over the entities of some nodes, whose handles it holds until :meth:`release`.

    It omits entities of busy callback groups; ``wakers`` are guard conditions that end a wait.
    Subscriptions of a :class:`PolledGroup` are ready whenever a wait ends, but not more often than
    their polling period.
    """

    def __init__(self, nodes: list[Any], wakers: tuple[Any, ...], context: Any) -> None:
        self._events_due = 0.0
        self._polled_at = 0.0
        with ExitStack() as held:
            self._tables = {
                kind: _hold(held, (entity for node in nodes for entity in getattr(node, listed)))
                for kind, listed in _ENTITIES.items()
            }
            listened = self._tables["subscription"]
            self._polled = [
                listened.pop(pointer)
                for pointer, one in list(listened.items())
                if isinstance(one.callback_group, PolledGroup)
            ]
            waitables = _hold_waitables(
                held, (waitable for node in nodes for waitable in node.waitables)
            )
            self._handlers = [one for one in waitables if type(one) is EventHandler]
            self._waitables = [one for one in waitables if type(one) is not EventHandler]
            held.enter_context(context.handle)
            self._wait_set = self._make(waitables, len(wakers), context)
            events = _Events()
            for handler in self._handlers:
                handler.add_to_wait_set(events)
            self._events = events.handles
            self._additions = [
                (getattr(self._wait_set, f"add_{kind}"), entity.handle)
                for kind, table in self._tables.items()
                for entity in table.values()
            ]
            self._additions += [(self._wait_set.add_guard_condition, waker) for waker in wakers]
            self._held = held.pop_all()

    def _make(self, waitables: list[Any], wakers: int, context: Any) -> Any:
        count = NumberOfEntities(
            len(self._tables["subscription"]),
            len(self._tables["guard_condition"]) + wakers,
            len(self._tables["timer"]),
            len(self._tables["client"]),
            len(self._tables["service"]),
        )
        for waitable in waitables:
            count += waitable.get_num_entities()
        return rclpy_implementation.WaitSet(
            count.num_subscriptions,
            count.num_guard_conditions,
            count.num_timers,
            count.num_clients,
            count.num_services,
            count.num_events,
            context.handle,
        )

    @property
    def timers(self) -> list[Any]:
        """The timers among the entities."""
        return list(self._tables["timer"].values())

    def wait(self, timeout_s: float | None) -> list[tuple[str, Any]]:
        """Wait for entities; return the ready ones with their kinds, or early none."""
        now = time.monotonic()
        polls_events = now >= self._events_due
        if polls_events:
            self._events_due = now + _EVENTS_S
        wait_set = self._wait_set
        wait_set.clear_entities()
        if polls_events:
            for event in self._events:
                wait_set.add_event(event)
        for add, handle in self._additions:
            add(handle)
        for waitable in self._waitables:
            waitable.add_to_wait_set(wait_set)
        left_s = self._events_due - now
        if self._polled:
            left_s = max(0.0, min(left_s, self._polled_at + _POLLS_S[1] - now))
        wait_set.wait(int(1e9 * (left_s if timeout_s is None else min(timeout_s, left_s))))
        # First, because timers check whether the senders of polled messages are silent.
        ready = [("polled", one) for one in self._take_polled()]
        ready += [("waitable", one) for one in self._waitables if one.is_ready(wait_set)]
        for kind, table in self._tables.items():
            if table:
                pointers = wait_set.get_ready_entities(kind)
                ready += [(kind, table[pointer]) for pointer in pointers if pointer in table]
        if polls_events:
            ready += [("waitable", one) for one in self._handlers if one.is_ready(wait_set)]
        return ready

    def _take_polled(self) -> list[Any]:
        """Return the polled subscriptions, if they are due."""
        now = time.monotonic()
        if not self._polled or now < self._polled_at + _POLLS_S[0]:
            return []
        self._polled_at = now
        return self._polled

    def release(self) -> None:
        """Release the handles, so that destroyed entities are freed."""
        self._held.close()


def _hold(held: ExitStack, entities: Iterable[Any]) -> dict[int, Any]:
    """Return the entities to wait for, by the pointer that a wait set returns."""
    found = {}
    for entity in entities:
        if entity.callback_group.can_execute(entity):
            with suppress(InvalidHandle):
                held.enter_context(entity.handle)
                found[entity.handle.pointer] = entity
    return found


def _hold_waitables(held: ExitStack, waitables: Iterable[Any]) -> list[Any]:
    found = []
    for waitable in waitables:
        if waitable.callback_group.can_execute(waitable):
            with suppress(InvalidHandle):
                held.enter_context(waitable)
                found.append(waitable)
    return found


class _Events:
    """Stand-in for a wait set that collects the handles of event handlers.

    Attributes:
        handles: Handles added so far.
    """

    def __init__(self) -> None:
        self.handles: list[Any] = []

    def add_event(self, handle: Any) -> int:
        """Store the handle; return its index, like a wait set."""
        self.handles.append(handle)
        return len(self.handles) - 1
