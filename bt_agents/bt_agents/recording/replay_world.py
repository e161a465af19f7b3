# SPDX-License-Identifier: Apache-2.0
"""A world that answers from the notes of a run, and the run repeated in it turn by turn."""

from __future__ import annotations

import json
import math
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from random import Random
from typing import Any, cast

from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.environment import GoalRun, GoalState, Inbox, SkillGoal
from bt_agents.engine.leaves import Leaf
from bt_agents.engine.run import Run, RunLimits, RunResult, StatusChange
from bt_agents.engine.scope import Scope
from bt_agents.recording.recording_run import FORMAT
from bt_agents.recording.recording_world import at_first
from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_language.model.specs import AgentSpec, NodeSpec

MOST_TURNS = 10_000_000
"""Turns of a record that are repeated; more of them are a slip of the pen."""


@dataclass(frozen=True, kw_only=True)
class Turn:
    """One turn of a run that was repeated.

    Attributes:
        number: From 1.
        tick: Ticks of the tree so far.
        changes: What has changed, in order.
        changed: How many changes the notes tell of.
        asked: What it asked for, as the notes write it.
        noted: What the notes say that it asked for.
        result: How the run has ended; None before that.
        end: How the notes say that it has ended; None before that.
    """

    number: int
    tick: int
    changes: list[StatusChange]
    changed: int
    asked: list[Any]
    noted: list[Any]
    result: RunResult | None
    end: Mapping[str, Any] | None


@dataclass(frozen=True, kw_only=True)
class Record:
    """The notes of a run.

    Attributes:
        head: What was known before the first turn.
        notes: Number of a turn → what was noted about it.
        stopped: Why the notes end before the run, or where some of them are missing; empty when
            they do not.
    """

    head: Mapping[str, Any]
    notes: Mapping[int, Mapping[str, Any]]
    stopped: str = ""

    @property
    def turns(self) -> int:
        """Number of the last turn that was noted."""
        return max(self.notes, default=0)

    @property
    def ended(self) -> bool:
        """Whether the notes go on to the end of the run."""
        return bool(self.notes) and "end" in self.notes[self.turns]


def read_record(lines: Iterable[str]) -> Record:
    """Return the notes of a run.

    What follows a line that is missing cannot be repeated and is left out.

    Args:
        lines: As :class:`bt_agents.recording.recording_run.RecordingRun` wrote them, in order.

    Raises:
        Refused: ``BAD_RECORD``; the first line is missing, or one cannot be read.
    """
    head: Mapping[str, Any] | None = None
    notes: dict[int, Mapping[str, Any]] = {}
    stopped = ""
    last = 0
    for line in lines:
        note = _parsed(line)
        if head is None:
            if note.get("format") != FORMAT:
                raise _bad(f"it begins with the form {note.get('format')}, expected {FORMAT}")
            head = note
        elif "stopped" in note:
            stopped = str(note["stopped"])
        else:
            turn, quiet = note.get("turn"), note.get("quiet", 0)
            if not isinstance(turn, int) or not last < turn <= MOST_TURNS:
                raise _bad(f"a note has the turn {turn!r}, expected a later one than before")
            if not isinstance(quiet, int):
                raise _bad(f"turn {turn} comes after {quiet!r} quiet ones, expected a number")
            if turn - 1 != last + quiet:
                stopped = f"notes between the turns {last} and {turn} are missing"
                break
            notes[turn] = note
            last = turn
    if head is None:
        raise _bad("it is empty")
    return Record(head=head, notes=notes, stopped=stopped)


def repeat(record: Record, spec: AgentSpec, space: SceneSpace) -> Iterator[Turn]:
    """Repeat a run turn by turn, up to its end or to that of its notes.

    Args:
        record: Its notes.
        spec: The agent.
        space: The scene parameters.

    Raises:
        Refused: ``BAD_RECORD``; a note has not the form that it should have.
    """
    try:
        yield from _repeat(record, spec, space)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise _bad(f"{type(error).__name__}: {error}") from error


def _repeat(record: Record, spec: AgentSpec, space: SceneSpace) -> Iterator[Turn]:
    head = record.head
    if head["parameters"] != list(space.names):
        raise _bad(f"it has the parameters {head['parameters']}, expected {list(space.names)}")
    scene = _scene(head["scene"])
    world = RecordedWorld(head, scene)
    run = Run(
        spec,
        space=space,
        scene=scene,
        profile=tuple(head["profile"]),
        live=lambda: world.live,
        tunables=world.tunables,
        world=world,
        steady=lambda: world.steady,
        limits=RunLimits(**head["limits"]),
        random=Random(head["seed"]),
        stopwatch=lambda: 0.0,
        plugins=world.plugin,
    )
    for number in range(1, record.turns + 1):
        note = record.notes.get(number, {})
        world.hear(note)
        changes: list[StatusChange] = []
        for what, *how in note.get("do", ()):
            if what == "hurry":
                run.hurry(float(how[0]))
            else:
                changes += run.cancel(str(how[0]), clean_up=bool(how[1]))
        changes += run.tick()
        yield Turn(
            number=number,
            tick=run.ticks,
            changes=changes,
            changed=int(note.get("changes", 0)),
            asked=world.asked,
            noted=list(note.get("out", ())),
            result=run.result,
            end=note.get("end"),
        )
        if run.result is not None:
            return


class RecordedWorld:
    """Answers as the outside did when the run was recorded.

    Args:
        head: First note of the record.
        scene: As awarded.

    Attributes:
        live: The live scene in this turn.
        steady: The steady clock in this turn [s].
        tunables: The tunables in this turn.
        asked: What the tree has asked for in this turn, as the notes write it.
    """

    def __init__(self, head: Mapping[str, Any], scene: Scene) -> None:
        self.live = scene
        self.steady = 0.0
        self.tunables: dict[str, Plain] = {}
        self.asked: list[Any] = []
        self._time = 0.0
        self._goals: defaultdict[int, _RecordedGoal] = defaultdict(_RecordedGoal)
        self._sent = 0
        self._inboxes: defaultdict[int, _RecordedInbox] = defaultdict(_RecordedInbox)
        self._watched = 0
        self._errors: deque[Any] = deque()
        self._plugins: defaultdict[str, deque[tuple[str, str]]] = defaultdict(deque)
        self.hear(head)

    def clock(self) -> float:
        """Return the trees' time [s]."""
        return self._time

    def hear(self, note: Mapping[str, Any]) -> None:
        """Begin a turn with what was noted about it."""
        self._time = float(note.get("t", self._time))
        self.steady = float(note.get("s", self.steady))
        if "tunables" in note:
            self.tunables.clear()
            self.tunables.update(note["tunables"])
        if "live" in note:
            self.live = _with(self.live, note["live"])
        for number, name, value, late in note.get("goals", ()):
            self._goals[number].hear(name, value, late=late)
        for inbox in self._inboxes.values():
            inbox.messages.clear()
        for number, message in note.get("inbox", ()):
            self._inboxes[number].messages.append(message)
        self._plugins.clear()
        for path, status, message in note.get("plugins", ()):
            self._plugins[path].append((status, message))
        self.asked = []
        self._errors = deque(out[3] if len(out) > 3 else None for out in note.get("out", ()))

    def send(self, goal: SkillGoal) -> GoalRun:
        """Take a goal; it goes as it went."""
        self._ask(goal.kind.value, goal.name, goal.fields)
        return self._opened()

    def publish(self, goal: SkillGoal) -> None:
        """Take a message."""
        self._ask(goal.kind.value, goal.name, goal.fields)

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> Inbox:
        """Open an inbox with what came into it."""
        self._ask("watch", topic, {})
        self._watched += 1
        return self._inboxes[self._watched - 1]

    def log(self, level: str, text: str) -> None:
        """Write nothing: what is repeated was logged once already."""

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> GoalRun:
        """Take feedback; it goes as it went."""
        self._ask("feedback", kind.name, {"values": dict(values), "reason": reason})
        return self._opened()

    def plugin(self, spec: NodeSpec, context: RunContext, scope: Scope) -> Leaf:
        """Return a leaf that answers as the behaviour from a package did."""
        return _PlayedPlugin(spec, context, scope, self._plugins)

    def _opened(self) -> GoalRun:
        self._sent += 1
        return self._goals[self._sent - 1]

    def _ask(self, kind: str, name: str, fields: Mapping[str, Plain]) -> None:
        error = self._errors.popleft() if self._errors else None
        asked = [kind, name, fields]
        self.asked.append(asked if error is None else [*asked, error])
        if error is None:
            return
        code, *words = error
        if code:
            raise Refused(str(code), str(words[0]))
        raise _again(str(words[0]))(words[1])


class _RecordedGoal:
    """A goal that goes as it went."""

    def __init__(self) -> None:
        self._known = at_first()
        self._late: dict[str, Any] = {}

    @property
    def state(self) -> GoalState:
        """See :class:`GoalRun`."""
        return cast(GoalState, self._known["state"])

    @property
    def confirmed(self) -> bool:
        """See :class:`GoalRun`."""
        return bool(self._known["confirmed"])

    @property
    def message(self) -> str:
        """See :class:`GoalRun`."""
        return str(self._known["message"])

    @property
    def result(self) -> Mapping[str, Plain]:
        """See :class:`GoalRun`."""
        return cast("Mapping[str, Plain]", self._known["result"])

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        """See :class:`GoalRun`."""
        return cast("Mapping[str, Plain] | None", self._known["feedback"])

    def hear(self, name: str, value: Any, *, late: bool) -> None:
        """Take what was noted about it; what is late comes out with its cancel."""
        if name not in self._known:
            raise ValueError(f"a goal has no '{name}'")
        known = self._late if late else self._known
        known[name] = GoalState[value] if name == "state" else value

    def cancel(self) -> None:
        """See :class:`GoalRun`."""
        self._known |= self._late
        self._late.clear()


class _RecordedInbox:
    """An inbox that gives in a turn what it gave."""

    def __init__(self) -> None:
        self.messages: deque[Mapping[str, Plain]] = deque()

    def take(self) -> Mapping[str, Plain] | None:
        """See :class:`Inbox`."""
        return self.messages.popleft() if self.messages else None

    def close(self) -> None:
        """See :class:`Inbox`."""


class _PlayedPlugin(Leaf):
    """Answers as a behaviour from a package did, without it."""

    acts = True

    def __init__(
        self,
        spec: NodeSpec,
        context: RunContext,
        scope: Scope,
        answers: Mapping[str, deque[tuple[str, str]]],
    ) -> None:
        super().__init__(spec, context, scope)
        self._answers = answers

    def update(self) -> Status:
        """Answer as it did."""
        status, self.feedback_message = self._answers[self.spec.path].popleft()
        return cast(Status, Status[status])

    def terminate(self, new_status: Status) -> None:
        """Say what it said at its end."""
        answers = self._answers[self.spec.path]
        if answers and not answers[0][0]:
            self.feedback_message = answers.popleft()[1]


def _scene(written: Mapping[str, Any]) -> Scene:
    values = [{**value, "origin": Origin(value["origin"])} for value in written["values"]]
    return Scene(**{**written, "values": tuple(SceneValue(**value) for value in values)})


def _with(scene: Scene, news: Mapping[str, Any]) -> Scene:
    """Return a live scene with what is new in it."""
    changed = dict(news)
    if "values" in changed:
        changed["values"] = tuple(
            SceneValue.missing(before.name)
            if math.isnan(value)
            else replace(before, value=float(value), origin=Origin.MEASURED)
            for before, value in zip(scene.values, changed["values"], strict=True)
        )
    return replace(scene, **changed)


def _parsed(line: str) -> Mapping[str, Any]:
    try:
        note = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise _bad(f"a line is no JSON ({error})") from None
    if not isinstance(note, dict):
        raise _bad(f"a line holds a {type(note).__name__}, expected a mapping")
    return note


def _bad(words: str) -> Refused:
    return Refused("BAD_RECORD", f"the record of a run cannot be repeated: {words}")


def _again(name: str) -> type[Exception]:
    """Return an exception of a name; its words are what a node tells of it."""
    return type(name, (Exception,), {})
