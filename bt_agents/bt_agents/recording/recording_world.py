# SPDX-License-Identifier: Apache-2.0
"""Everything of the outside that a recorded run looks at, noted as it is looked at."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from random import Random
from typing import Any

from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.environment import Clock, Environment, GoalRun, GoalState, Inbox, SkillGoal
from bt_agents.engine.leaves import Leaf
from bt_agents.engine.scope import RunScope, Scope
from bt_agents.plugins.plugin_leaf import PluginLeaf
from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_core.scene import Scene
from bt_agents_language.model.specs import NodeSpec

Note = dict[str, Any]


class Notebook:
    """The world of a run that is recorded, and all else that the run looks at.

    Args:
        world: What the tree can reach.
        live: See :class:`Run`.
        tunables: See :class:`Run`.
        steady: See :class:`Run`.

    Attributes:
        clock: The trees' clock, which stands still during a turn.
        turn: Turns that have ended.
        open: Whether one has begun, by something that the host does before its tick.
        tunables: Their values as they are now.
        tuned: The same as they were noted last.
        note: What is noted about the turn so far.
        closed: Whether nothing is noted any more; the outside still stands still during a turn.
    """

    def __init__(
        self,
        world: Environment,
        live: Callable[[], Scene],
        tunables: Mapping[str, Plain],
        steady: Clock,
    ) -> None:
        self.clock = NotedClock(world.clock, self, "t")
        self.steady = NotedClock(steady, self, "s")
        self._live = live
        self._scene: Scene | None = None
        self._seen_in = -1
        self.turn = -1
        self.open = False
        self.tunables = tunables
        self.tuned = dict(tunables)
        self.note: Note = {}
        self.closed = False
        self._world = world
        self._told_live: Note = {}
        self._goals = 0
        self._inboxes = 0

    def first(self) -> Note:
        """Return what was known before the first turn."""
        self.live()
        first = {"tunables": self.tuned, "live": self._told_live, "t": self.clock()}
        self.note = {}
        self.turn = 0
        return first

    def begin(self) -> None:
        """Begin a turn, unless it has begun."""
        if not self.open:
            self.open = True
            if self.tuned != self.tunables:
                self.note["tunables"] = self.tuned = dict(self.tunables)

    def do(self, what: str, *how: Plain) -> None:
        """Note what the host does besides ticking."""
        self.begin()
        self.add("do", [what, *how])

    def end(self) -> Note:
        """End a turn; return what is to be noted about it."""
        self.turn += 1
        self.open = False
        note, self.note = self.note, {}
        return note

    def add(self, key: str, entry: list[Any]) -> None:
        """Note one of several things."""
        if not self.closed:
            self.note.setdefault(key, []).append(entry)

    def send(self, goal: SkillGoal) -> GoalRun:
        """Send a goal; see :class:`Environment`."""
        out = self._asked(goal)
        run = self._tried(lambda: self._world.send(goal), out)
        return self._opened(run)

    def publish(self, goal: SkillGoal) -> None:
        """Publish a message; see :class:`Environment`."""
        out = self._asked(goal)
        self._tried(lambda: self._world.publish(goal), out)

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> Inbox:
        """Listen; see :class:`Environment`."""
        out = ["watch", topic, {}]
        self.add("out", out)
        inbox = self._tried(lambda: self._world.watch(topic, type_name, latched=latched), out)
        self._inboxes += 1
        return _NotedInbox(inbox, self._inboxes - 1, self)

    def log(self, level: str, text: str) -> None:
        """Write a line into the log."""
        self._world.log(level, text)

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> GoalRun:
        """Ask for a change of the profile; see :class:`Environment`."""
        out = ["feedback", kind.name, {"values": dict(values), "reason": reason}]
        self.add("out", out)
        run = self._tried(lambda: self._world.give_feedback(kind, values, reason), out)
        return self._opened(run)

    def live(self) -> Scene:
        """Return the scene as it is now; it stands still during a turn."""
        if self._scene is not None and self._seen_in == self.turn:
            return self._scene
        self._seen_in = self.turn
        scene = self._live()
        if scene is not self._scene:
            self._scene = scene
            live = _live(scene)
            new = {k: v for k, v in live.items() if not _same(v, self._told_live.get(k))}
            self._told_live = live
            if new:
                self.note["live"] = new
        return scene

    def plugin(self, spec: NodeSpec, context: RunContext, scope: Scope) -> Leaf:
        """Return the leaf of a behaviour from a package, whose answers are noted."""
        return _NotedPlugin(spec, context, scope, self)

    def _asked(self, goal: SkillGoal) -> list[Any]:
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


class NotedClock:
    """A clock that stands still during a turn, and is noted when somebody reads it.

    Args:
        look: Returns the time [s].
        notebook: Takes the notes.
        key: Under which the time is noted.
    """

    def __init__(self, look: Clock, notebook: Notebook, key: str) -> None:
        self._look = look
        self._notebook = notebook
        self._key = key
        self._turn: int | None = None
        self._now = self._told = math.nan

    def __call__(self) -> float:
        """Return the time of this turn [s]."""
        if self._turn != self._notebook.turn:
            self._turn, self._now = self._notebook.turn, self._look()
        if self._now != self._told:
            self._notebook.note[self._key] = self._told = self._now
        return self._now

    def reached(self, at: float) -> bool:
        """Return whether a time has come [s]; as long as it has not, nothing need be noted.

        By the time that was noted last, it has not come either.
        """
        if self._turn != self._notebook.turn:
            self._turn, self._now = self._notebook.turn, self._look()
        return not self._told <= self._now < at and self() >= at


class NotedContext(RunContext):
    """What the nodes of a recorded run share, in the world of a :class:`Notebook`."""

    def __init__(self, world: Environment, scope: RunScope, random: Random) -> None:
        super().__init__(world, scope, random)
        assert isinstance(world, Notebook)
        self._reached = world.clock.reached

    def reached(self, path: str, at: float) -> bool:
        """See :meth:`RunContext.reached`."""
        if self._reached(at):
            return True
        self.wakes[path] = at
        return False


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
        taken = inbox.take

        def take() -> Mapping[str, Plain] | None:
            message = taken()
            if message is not None:
                notebook.add("inbox", [number, message])
            return message

        self.take = take
        self.close = inbox.close


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
