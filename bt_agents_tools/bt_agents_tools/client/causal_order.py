# SPDX-License-Identifier: Apache-2.0
"""Causal order of a system's events: each after its causes, in whatever order they arrive."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple

from bt_agents_core.scene import first_id
from bt_agents_interfaces.msg import Auction, TreeStatus
from bt_agents_ros.messages import seconds

SETTLE_S = 0.1
"""Time that an event waits for events that were sent before it [s]."""

LONGEST_WAIT_S = 0.3
"""Longest time that an event waits for its causes [s]."""

MOST_FACTS = 1000
"""Maximum number of remembered facts; the oldest are forgotten first."""

_LONGEST_DELAY_S = 1.0

Fact = tuple[Hashable, ...]
"""Fact that has happened, such as the award of a round."""


class Links(NamedTuple):
    """Facts that precede an event, and those that it establishes."""

    causes: frozenset[Fact] = frozenset()
    facts: frozenset[Fact] = frozenset()


@dataclass(frozen=True, kw_only=True)
class CausalEvent:
    """Event of a system.

    Attributes:
        sent_s: When it happened, by the clock of its sender [s].
        deliver: Callback for its delivery.
        links: The facts before and after it.
    """

    sent_s: float
    deliver: Callable[[], None]
    links: Links


@dataclass(frozen=True, kw_only=True)
class _Waiting:
    event: CausalEvent
    number: int
    came_s: float


_TURN = attrgetter("event.sent_s", "number")


class CausalOrder:
    """Buffer of events that delivers each after its causes, and otherwise in the order of sending.

    Each event waits :data:`SETTLE_S` for events that were sent before it, and for its causes until
    :data:`LONGEST_WAIT_S` after its arrival; the first call after that delivers it. Times of calls
    are on the steady clock; times of sending are only compared with each other.
    """

    def __init__(self) -> None:
        self._waiting: list[_Waiting] = []
        self._count = 0
        self._known: OrderedDict[Fact, None] = OrderedDict()

    @property
    def is_empty(self) -> bool:
        """True when no event waits."""
        return not self._waiting

    def put(self, event: CausalEvent, now: float) -> None:
        """Store an event that arrives now [s]."""
        self._count += 1
        self._waiting.append(_Waiting(event=event, number=self._count, came_s=now))

    def deliver_due(self, now: float) -> None:
        """Deliver the events that are due now [s]."""
        settled = [_TURN(one) for one in self._waiting if now - one.came_s >= SETTLE_S]
        if not settled:
            return
        last = max(settled)
        turn = deque(sorted((o for o in self._waiting if _TURN(o) <= last), key=_TURN))
        self._waiting = [one for one in self._waiting if _TURN(one) > last]
        held: list[_Waiting] = []
        while turn:
            one = turn.popleft()
            is_overdue = now - one.came_s >= LONGEST_WAIT_S
            if not (is_overdue or one.event.links.causes <= self._known.keys()):
                held.append(one)
                continue
            facts = one.event.links.facts
            self._remember(facts)
            one.event.deliver()
            if any(other.event.links.causes & facts for other in held):
                turn.extendleft(reversed(held))
                held = []
        self._waiting += held

    def _remember(self, facts: frozenset[Fact]) -> None:
        for fact in facts:
            self._known[fact] = None
            self._known.move_to_end(fact)
        while len(self._known) > MOST_FACTS:
            self._known.popitem(last=False)


def no_links(_message: Any) -> Links:
    """Return the links of an independent event."""
    return Links()


def scene_links(scene: Any) -> Links:
    """Return the links of a ``Scene.msg``."""
    return Links(facts=frozenset({("scene", scene.scene_id)}))


def auction_links(auction: Any) -> Links:
    """Return the links of an ``Auction.msg``: its announced scene precedes it.

    Follow-up rounds, and scenes that people award, have no announced scene.
    """
    scene_id = auction.scene.scene_id
    is_first = not auction.follows and first_id(scene_id) == scene_id
    causes = {("scene", scene_id)} if is_first and not auction.intervention else set()
    return Links(frozenset(causes), frozenset({_fact("round", auction)}))


def run_links(run: Any) -> Links:
    """Return the links of a ``Run.msg``: the award, the start and the last tick precede it."""
    if run.event in (run.STARTED, run.REFUSED):
        facts = {_fact("run", run)} if run.event == run.STARTED else set()
        return Links(frozenset({_fact("round", run)}), frozenset(facts))
    if run.event != run.ENDED:
        return Links(frozenset({_fact("run", run)}))
    causes = {_fact("run", run)}
    if run.ticks and run.outcome != run.LOST:
        causes.add((*_fact("tick", run), run.ticks))
    return Links(frozenset(causes), frozenset({_fact("end", run)}))


def tree_links(status: Any) -> Links:
    """Return the links of a ``TreeStatus.msg``: the award and the first tick precede it.

    A first tick is a start: it may arrive before the market's message.
    """
    tick = (*_fact("tick", status), status.tick)
    if status.tick > 1:
        return Links(frozenset({(*_fact("tick", status), 1)}), frozenset({tick}))
    return Links(frozenset({_fact("round", status)}), frozenset({tick, _fact("run", status)}))


def scene_end_links(end: Any) -> Links:
    """Return the links of a ``SceneEnd.msg``: the end of its last run or the scene precedes it."""
    cause = _fact("end", end) if end.agent and end.round else ("scene", first_id(end.scene_id))
    return Links(frozenset({cause}))


def feedback_links(feedback: Any) -> Links:
    """Return the links of a ``Feedback.msg``: the start of its run precedes it."""
    return Links(frozenset({_fact("run", feedback)} if feedback.round else ()))


def happened_s(message: Any, sent_s: float) -> float:
    """Return when a round closed or a tree was ticked, from the message about it [s].

    The effects of either may be sent before that message. A stamp of another clock, such as
    simulated time, does not count.
    """
    if not isinstance(message, Auction | TreeStatus):
        return sent_s
    stamp_s = seconds(message.header.stamp)
    return stamp_s if 0.0 <= sent_s - stamp_s <= _LONGEST_DELAY_S else sent_s


def _fact(what: str, message: Any) -> Fact:
    return (what, message.epoch, message.round)
