# SPDX-License-Identifier: Apache-2.0
"""Everything of the outside that a recorded run looks at, noted as it is looked at."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.leaves import Leaf
from bt_agents.engine.plugin_leaf import PluginLeaf
from bt_agents.engine.scope import Scope
from bt_agents.engine.world import Clock, Goal, GoalRun, GoalState, Inbox, World
from bt_agents.errors import Refused
from bt_agents.feedback import Kind
from bt_agents.language.specs import NodeSpec, Plain
from bt_agents.scene import Scene

Note = dict[str, Any]

T = TypeVar("T")


class Notebook:
    """The world of a run that is recorded, and all else that the run looks at.

    Args:
        world: What the tree can reach.
        live: See :class:`Run`.
        tunables: See :class:`Run`.
        steady: See :class:`Run`.

    Attributes:
        clock: The trees' clock, which stands still during a turn.
        turn: Turns so far.
        closed: Whether nothing is noted any more; the outside still stands still during a turn.
    """

    def __init__(
        self,
        world: World,
        live: Callable[[], Scene],
        tunables: Mapping[str, Plain],
        steady: Clock,
    ) -> None:
        self.clock = _Still(world.clock)
        self.steady = _Still(steady)
        self.live = _Still(live)
        self.turn = 0
        self.closed = False
        self._clocks = (("t", self.clock), ("s", self.steady))
        self._world = world
        self._tunables = tunables
        self._tuned = dict(tunables)
        self._told_live: Note = {}
        self._open = False
        self._goals = 0
        self._inboxes = 0
        self._note: Note = {}

    def first(self) -> Note:
        """Return what was known before the first turn."""
        self._told_live = _live(self.live())
        first = {"tunables": self._tuned, "live": self._told_live, "t": self.clock()}
        self._rest()
        return first

    def begin(self) -> None:
        """Begin a turn, unless it has begun."""
        if self._open:
            return
        self._open = True
        self.turn += 1
        if self._tuned != self._tunables:
            self._tuned = dict(self._tunables)
            self._note["tunables"] = self._tuned

    def do(self, what: str, *how: Plain) -> None:
        """Note what the host does besides ticking."""
        self.begin()
        self.add("do", [what, *how])

    def end(self) -> Note:
        """End a turn; return what is to be noted about it."""
        for key, clock in self._clocks:
            if (now := clock.news()) is not None:
                self._note[key] = now
        if (scene := self.live.news()) is not None:
            live = _live(scene)
            new = {k: v for k, v in live.items() if not _same(v, self._told_live.get(k))}
            if new:
                self._told_live = live
                self._note["live"] = new
        note, self._note = self._note, {}
        self._rest()
        self._open = False
        return note

    def add(self, key: str, entry: list[Any]) -> None:
        """Note one of several things."""
        if not self.closed:
            self._note.setdefault(key, []).append(entry)

    def send(self, goal: Goal) -> GoalRun:
        """Send a goal; see :class:`World`."""
        out = self._asked(goal)
        run = self._tried(lambda: self._world.send(goal), out)
        return self._opened(run)

    def publish(self, goal: Goal) -> None:
        """Publish a message; see :class:`World`."""
        out = self._asked(goal)
        self._tried(lambda: self._world.publish(goal), out)

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> Inbox:
        """Listen; see :class:`World`."""
        out = ["watch", topic, {}]
        self.add("out", out)
        inbox = self._tried(lambda: self._world.watch(topic, type_name, latched=latched), out)
        self._inboxes += 1
        return _NotedInbox(inbox, self._inboxes - 1, self)

    def log(self, level: str, text: str) -> None:
        """Write a line into the log."""
        self._world.log(level, text)

    def give_feedback(self, kind: Kind, values: Mapping[str, float], reason: str) -> GoalRun:
        """Ask for a change of the profile; see :class:`World`."""
        out = ["feedback", kind.name, {"values": dict(values), "reason": reason}]
        self.add("out", out)
        run = self._tried(lambda: self._world.give_feedback(kind, values, reason), out)
        return self._opened(run)

    def plugin(self, spec: NodeSpec, context: RunContext, scope: Scope) -> Leaf:
        """Return the leaf of a behaviour from a package, whose answers are noted."""
        return _NotedPlugin(spec, context, scope, self)

    def _asked(self, goal: Goal) -> list[Any]:
        out = [goal.kind.value, goal.name, goal.fields]
        self.add("out", out)
        return out

    def _tried(self, call: Callable[[], Any], out: list[Any]) -> Any:
        try:
            return call()
        except Refused as refused:
            out.append([refused.code, refused.reason])
            raise
        except Exception as error:
            out.append(["", type(error).__name__, str(error)])
            raise

    def _opened(self, run: GoalRun) -> GoalRun:
        self._goals += 1
        return _NotedGoal(run, self._goals - 1, self)

    def _rest(self) -> None:
        """Let the outside go on."""
        self.clock.rest()
        self.steady.rest()
        self.live.rest()


class _Still(Generic[T]):
    """Something of the outside that is looked at once a turn."""

    def __init__(self, look: Callable[[], T]) -> None:
        self._look = look
        self._seen: T | None = None
        self._told: T | None = None

    def __call__(self) -> T:
        if self._seen is None:
            self._seen = self._look()
        return self._seen

    def news(self) -> T | None:
        """Return what was seen, if it is another than at the last news; else None."""
        return None if self._seen == self._told else self._seen

    def rest(self) -> None:
        """Look anew in the next turn."""
        if self._seen is not None:
            self._told, self._seen = self._seen, None


class _NotedGoal:
    """A goal whose answers are noted; it stands still during a turn until it is cancelled."""

    def __init__(self, run: GoalRun, number: int, notebook: Notebook) -> None:
        self._run = run
        self._number = number
        self._notebook = notebook
        self._told = at_first()
        self._turn = -1
        self._still: dict[str, Any] = {}
        self._cancelled = False

    @property
    def state(self) -> GoalState:
        """See :class:`GoalRun`."""
        state: GoalState = self._look("state")
        return state

    @property
    def confirmed(self) -> bool:
        """See :class:`GoalRun`."""
        return bool(self._look("confirmed"))

    @property
    def message(self) -> str:
        """See :class:`GoalRun`."""
        return str(self._look("message"))

    @property
    def result(self) -> Mapping[str, Plain]:
        """See :class:`GoalRun`."""
        result: Mapping[str, Plain] = self._look("result")
        return result

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        """See :class:`GoalRun`."""
        feedback: Mapping[str, Plain] | None = self._look("feedback")
        return feedback

    def cancel(self) -> None:
        """See :class:`GoalRun`."""
        self._run.cancel()
        self._turn = self._notebook.turn
        self._still.clear()
        self._cancelled = True

    def _look(self, field: str) -> Any:
        if self._turn != self._notebook.turn:
            self._turn = self._notebook.turn
            self._still.clear()
            self._cancelled = False
        elif field in self._still:
            return self._still[field]
        value = self._still[field] = getattr(self._run, field)
        told = self._told[field]
        if value is told or (field != "feedback" and value == told):
            return value
        self._told[field] = value
        written = value.name if isinstance(value, GoalState) else value
        self._notebook.add("goals", [self._number, field, written, self._cancelled])
        return value


class _NotedInbox:
    """An inbox whose messages are noted when they are taken."""

    def __init__(self, inbox: Inbox, number: int, notebook: Notebook) -> None:
        self._inbox = inbox
        self._number = number
        self._notebook = notebook

    def take(self) -> Mapping[str, Plain] | None:
        """See :class:`Inbox`."""
        message = self._inbox.take()
        if message is not None:
            self._notebook.add("inbox", [self._number, message])
        return message

    def close(self) -> None:
        """See :class:`Inbox`."""
        self._inbox.close()


class _NotedPlugin(PluginLeaf):
    """A behaviour from a package whose answers are noted."""

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, notebook: Notebook
    ) -> None:
        super().__init__(spec, context, scope)
        self._notebook = notebook

    def update(self) -> Status:
        """Tick it and note its answer."""
        status = super().update()
        self._notebook.add("plugins", [self.spec.path, status.name, self.feedback_message])
        return status

    def terminate(self, new_status: Status) -> None:
        """End it and note what goes wrong with that."""
        before = self.feedback_message
        super().terminate(new_status)
        if self.feedback_message != before:
            self._notebook.add("plugins", [self.spec.path, "", self.feedback_message])


def at_first() -> dict[str, Any]:
    """Return what a goal answers right after it was sent: field → value."""
    return {
        "state": GoalState.PENDING,
        "confirmed": False,
        "message": "",
        "result": {},
        "feedback": None,
    }


def _live(scene: Scene) -> Note:
    """Return what a tree can know of a live scene."""
    return {
        "person": scene.person,
        "person_id": scene.person_id,
        "place": scene.place,
        "persons": scene.persons,
        "stale_s": scene.stale_s,
        "values": list(scene.vector),
    }


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    both_nan = isinstance(one, float) and isinstance(other, float)
    return bool(one == other) or (both_nan and math.isnan(one) and math.isnan(other))
