# SPDX-License-Identifier: Apache-2.0
"""The environment of a recorded run, and one that answers from the recording."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from random import Random
from typing import Any

from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.environment import Clock, Environment, GoalRun, Inbox, PluginNode, SkillGoal
from bt_agents.engine.leaf import Leaf
from bt_agents.engine.scope import RunScope, Scope
from bt_agents.recording.format import Entry
from bt_agents.recording.recorded_answers import (
    RecordingGoal,
    RecordingInbox,
    ReplayGoal,
    ReplayInbox,
)
from bt_agents.recording.recorded_plugin import RecordingPlugin, ReplayPlugin
from bt_agents.recording.steps import RecordingClock, ReplayClock, StepLog
from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_core.local_time import NOON, LocalTime
from bt_agents_core.scene import Origin, Scene, SceneValue
from bt_agents_language.model.specs import NodeSpec


class RecordingEnvironment:
    """The environment of a recorded run, with clocks, live scene and tunables; see :class:`Run`.

    Attributes:
        steps: Log with the entry of the current step.
        clock: The trees' clock.
        steady: Clock of the bounded waits.
        tunables: Current values; they may change between steps.
        recorded_tunables: The last recorded values.
    """

    def __init__(
        self,
        environment: Environment,
        live: Callable[[], Scene],
        tunables: Mapping[str, Plain],
        steady: Clock,
    ) -> None:
        self.steps = StepLog()
        self.clock = RecordingClock(environment.clock, self.steps, "t")
        self.steady = RecordingClock(steady, self.steps, "s")
        self._environment = environment
        self._live = live
        self._scene: Scene | None = None
        self._scene_step = -1
        self._recorded_live: Entry = {}
        self._local_time: LocalTime | None = None
        self._local_time_step = -1
        self.tunables = tunables
        self.recorded_tunables = dict(tunables)
        self._goals = 0
        self._inboxes = 0

    def first(self) -> Entry:
        """Return what is known before the first step, which starts from it."""
        self.live()
        now = self.clock()
        self.steps.end()
        return {"tunables": self.recorded_tunables, "live": self._recorded_live, "t": now}

    def record_tunables(self) -> None:
        """Record the tunables after a change."""
        self.steps.entry["tunables"] = self.recorded_tunables = dict(self.tunables)

    def local_time(self) -> LocalTime:
        """Return the local time, which is frozen during a step."""
        if self._local_time is None or self._local_time_step != self.steps.step:
            self._local_time_step = self.steps.step
            before, self._local_time = self._local_time, self._environment.local_time()
            if self._local_time != before:
                self.steps.entry["clock"] = asdict(self._local_time)
        return self._local_time

    def send(self, goal: SkillGoal) -> GoalRun:
        """Send a goal; see :class:`Environment`."""
        with self._request(goal.kind.value, goal.name, goal.fields):
            return self._track(self._environment.send(goal))

    def publish(self, goal: SkillGoal) -> None:
        """Publish a message; see :class:`Environment`."""
        with self._request(goal.kind.value, goal.name, goal.fields):
            self._environment.publish(goal)

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> Inbox:
        """Subscribe; see :class:`Environment`."""
        with self._request("watch", topic, {}):
            inbox = self._environment.watch(topic, type_name, latched=latched)
        self._inboxes += 1
        return RecordingInbox(inbox, self._inboxes - 1, self.steps)

    def open_plugin_node(self, path: str) -> PluginNode | None:
        """Return the node for a plug-in; only the plug-in's answers are recorded."""
        return self._environment.open_plugin_node(path)

    def log(self, level: str, text: str) -> None:
        """Log a line; it is not recorded."""
        self._environment.log(level, text)

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> GoalRun:
        """Request a change of the profile; see :class:`Environment`."""
        with self._request("feedback", kind.name, _feedback_fields(values, reason)):
            return self._track(self._environment.give_feedback(kind, values, reason))

    def live(self) -> Scene:
        """Return the live scene, which is frozen during a step."""
        if self._scene is not None and self._scene_step == self.steps.step:
            return self._scene
        self._scene_step = self.steps.step
        scene = self._live()
        if scene is not self._scene:
            self._scene = scene
            live = _live_fields(scene)
            new = {k: v for k, v in live.items() if not _same(v, self._recorded_live.get(k))}
            self._recorded_live = live
            if new:
                self.steps.entry["live"] = new
        return scene

    def plugin(
        self, spec: NodeSpec, context: RunContext, scope: Scope, _build: BuildChild
    ) -> Leaf:
        """Return the leaf for a behaviour of a package."""
        return RecordingPlugin(spec, context, scope, self.steps)

    @contextmanager
    def _request(self, kind: str, name: str, fields: Mapping[str, Plain]) -> Iterator[None]:
        """Record a request, and the error of the call in the block."""
        request: Entry = {"kind": kind, "name": name, "fields": fields}
        self.steps.add("requests", request)
        try:
            yield
        except Refused as refused:
            request["error"] = {"code": refused.code, "reason": refused.reason}
            raise
        except Exception as error:
            request["error"] = {"type": type(error).__name__, "message": str(error)}
            raise

    def _track(self, run: GoalRun) -> GoalRun:
        self._goals += 1
        return RecordingGoal(run, self._goals - 1, self.steps)


class RecordingContext(RunContext):
    """Shared state of the nodes of a recorded run; deadlines not reached leave no entry."""

    def __init__(self, environment: Environment, scope: RunScope, random: Random) -> None:
        super().__init__(environment, scope, random)
        assert isinstance(environment, RecordingEnvironment)
        self._is_due = environment.clock.is_due
        self._steps = environment.steps
        self._plugin_goals: tuple[str, ...] = ()

    def is_due(self, path: str, at: float) -> bool:
        if self._is_due(at):
            return True
        self.deadlines[path] = at
        return False

    def plugin_goals(self) -> tuple[str, ...]:
        """Return the paths of plug-ins with open goals; changes are recorded."""
        before, self._plugin_goals = self._plugin_goals, super().plugin_goals()
        if self._plugin_goals != before:
            self._steps.entry["settling"] = list(self._plugin_goals)
        return self._plugin_goals


class ReplayContext(RunContext):
    """Shared state of the nodes of a replayed run."""

    def plugin_goals(self) -> tuple[str, ...]:
        """Return the paths of plug-ins with open goals as they were recorded."""
        assert isinstance(self.environment, ReplayEnvironment)
        return self.environment.plugin_goals


class ReplayEnvironment:
    """Answers as the environment did in this step of the recorded run.

    Its requests are those of the tree in this step, in the form of the recording.
    """

    def __init__(self, head: Mapping[str, Any], scene: Scene) -> None:
        self.clock = ReplayClock("t")
        self.steady = ReplayClock("s")
        self.live = scene
        self._local_time = NOON
        self.tunables: dict[str, Plain] = {}
        self.plugin_goals: tuple[str, ...] = ()
        self.requests: list[Entry] = []
        self._goals: defaultdict[int, ReplayGoal] = defaultdict(ReplayGoal)
        self._sent = 0
        self._inboxes: defaultdict[int, ReplayInbox] = defaultdict(ReplayInbox)
        self._opened = 0
        self._errors: deque[Entry | None] = deque()
        self._plugins: defaultdict[str, deque[Entry]] = defaultdict(deque)
        self.load(head)

    def load(self, entry: Mapping[str, Any]) -> None:
        """Begin a step with its entry."""
        self.clock.load(entry)
        self.steady.load(entry)
        if "tunables" in entry:
            self.tunables.clear()
            self.tunables.update(entry["tunables"])
        if "settling" in entry:
            self.plugin_goals = tuple(entry["settling"])
        if "clock" in entry:
            self._local_time = LocalTime(**entry["clock"])
        if "live" in entry:
            self.live = _with_live_fields(self.live, entry["live"])
        for goal in entry.get("goals", ()):
            self._goals[goal["goal"]].load(goal)
        for inbox in self._inboxes.values():
            inbox.messages.clear()
        for message in entry.get("messages", ()):
            self._inboxes[message["inbox"]].messages.append(message["message"])
        self._plugins.clear()
        for answer in entry.get("plugins", ()):
            self._plugins[answer["path"]].append(answer)
        self.requests = []
        self._errors = deque(request.get("error") for request in entry.get("requests", ()))

    def local_time(self) -> LocalTime:
        """Return the recorded local time."""
        return self._local_time

    def send(self, goal: SkillGoal) -> GoalRun:
        """Take a goal; its fields are as recorded."""
        self._request(goal.kind.value, goal.name, goal.fields)
        return self._track()

    def publish(self, goal: SkillGoal) -> None:
        """Take a message."""
        self._request(goal.kind.value, goal.name, goal.fields)

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> Inbox:
        """Open an inbox with the recorded messages."""
        self._request("watch", topic, {})
        self._opened += 1
        return self._inboxes[self._opened - 1]

    def open_plugin_node(self, path: str) -> None:
        """Return None, because plug-ins do not run."""

    def log(self, level: str, text: str) -> None:
        """Write nothing: the line was logged when the run was recorded."""

    def give_feedback(
        self, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> GoalRun:
        """Take feedback; its answer is as recorded."""
        self._request("feedback", kind.name, _feedback_fields(values, reason))
        return self._track()

    def plugin(
        self, spec: NodeSpec, context: RunContext, scope: Scope, _build: BuildChild
    ) -> Leaf:
        """Return a leaf that answers as the behaviour of a package did."""
        return ReplayPlugin(spec, context, scope, self._plugins)

    def _track(self) -> GoalRun:
        self._sent += 1
        return self._goals[self._sent - 1]

    def _request(self, kind: str, name: str, fields: Mapping[str, Plain]) -> None:
        error = self._errors.popleft() if self._errors else None
        request: Entry = {"kind": kind, "name": name, "fields": fields}
        self.requests.append(request)
        if error is None:
            return
        request["error"] = error
        if "code" in error:
            raise Refused(str(error["code"]), str(error["reason"]))
        # A node shows only its name and text.
        error_type: type[Exception] = type(str(error["type"]), (Exception,), {})
        raise error_type(error["message"])


def _feedback_fields(values: Mapping[str, float], reason: str) -> dict[str, Plain]:
    return {"values": dict(values), "reason": reason}


def _live_fields(scene: Scene) -> Entry:
    """Return the parts of a live scene that a tree can read."""
    return {
        "person": scene.person,
        "person_id": scene.person_id,
        "place": scene.place,
        "persons": scene.persons,
        "visits": scene.visits,
        "remembered": dict(scene.remembered),
        "stale_s": scene.stale_s,
        "values": list(scene.vector),
        "origins": [int(value.origin) for value in scene.values],
    }


def _with_live_fields(scene: Scene, new: Mapping[str, Any]) -> Scene:
    """Return a live scene with recorded fields; earlier recordings have no origins."""
    changed = dict(new)
    values = changed.pop("values", scene.vector)
    origins = changed.pop("origins", [int(one.origin or Origin.MEASURED) for one in scene.values])
    changed["values"] = tuple(
        SceneValue.missing(before.name)
        if math.isnan(value)
        else replace(before, value=float(value), origin=Origin(origin))
        for before, value, origin in zip(scene.values, values, origins, strict=True)
    )
    return replace(scene, **changed)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    both_nan = isinstance(one, float) and isinstance(other, float)
    return bool(one == other) or (both_nan and math.isnan(one) and math.isnan(other))
