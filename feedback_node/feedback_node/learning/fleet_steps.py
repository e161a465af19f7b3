# SPDX-License-Identifier: Apache-2.0
"""Steps of the robots of a fleet, and their replay in one order, whatever order they arrive in."""

from __future__ import annotations

import hashlib
import json
import math
import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, MutableMapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FLEET as FLEET_SOURCE
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.profile_layers import checked_layer
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import MAX_WEIGHT, SceneSpace, Vector
from feedback_node.learning import learning_step
from feedback_node.learning.cards import Agent
from feedback_node.ledger.rows import (
    AUTHORED,
    FEEDBACK,
    FLEET,
    FORGOTTEN,
    IMPORT,
    LAYER,
    RESET,
    UNDO,
    ProfileRevision,
    hidden_layer,
    is_hidden,
)

ROBOT_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,62}")
"""Pattern of the name of a robot in a fleet."""

LONGEST_NAME = 200
"""Most characters of the name of an agent."""

MOST_PARAMETERS = 100
"""Most values in a step."""

LATEST_S = 86_400.0
"""How far in the future the time of a step may be [s]."""

_MOST = 2**63 - 1
_BASE = re.compile(r"[0-9a-f]{16}")


class StepEvent(StrEnum):
    """Effect of a step on its profile.

    Feedback moves the profile. An undo, a reset or an import sets it. A profile begins once, with
    the first step that says how. Forgetting a layer discards everything before.
    """

    FEEDBACK = "feedback"
    SET = "set"
    BEGIN = "begin"
    FORGET = "forget"


_EVENTS: Mapping[str, StepEvent] = {
    FEEDBACK: StepEvent.FEEDBACK,
    UNDO: StepEvent.SET,
    RESET: StepEvent.SET,
    IMPORT: StepEvent.SET,
    AUTHORED: StepEvent.BEGIN,
    LAYER: StepEvent.BEGIN,
}


@dataclass(frozen=True, kw_only=True)
class FleetStep:
    """Step of a robot; it contains no text written by people.

    Attributes:
        robot: Name of the robot.
        number: Number of the row in its ledger.
        base: Version of the profile in the agent's file that it builds on; see :func:`base_of`.
        layer: Layer; empty for everybody, hidden by :func:`hidden_layer` if forgotten.
        target: Parameter → value: the target of the feedback, or the profile.
        weight: Weight of the source of the feedback, multiplied by the layer's share.
        changes: Number of feedbacks that led to the profile that it sets or begins with.
        stamp: Wall time of the robot [s].
        arrival: Position in the order of arrival at the database; 0 before that.
    """

    robot: str
    number: int
    agent: str
    layer: str = ""
    base: str
    event: StepEvent
    kind: FeedbackKind
    target: Mapping[str, float]
    weight: float = 1.0
    changes: int = 0
    stamp: float
    arrival: int = 0

    @property
    def key(self) -> tuple[float, str, int]:
        """Position of the step in the order of the fleet: time, robot, number."""
        return self.stamp, self.robot, self.number

    @property
    def feedback_id(self) -> str:
        """Id that makes a ledger record the step only once."""
        return f"fleet/{self.robot}/{self.number}"

    def fields(self) -> dict[str, Any]:
        """Return the fields in their JSON form; see :func:`read_step`."""
        fields = {**asdict(self), "event": self.event.value, "kind": int(self.kind)}
        return {**fields, "target": dict(self.target)}


def base_of(authored: Mapping[str, float]) -> str:
    """Return 16 digits that identify the version of the profile in an agent's file."""
    text = json.dumps(sorted((name, float(value)) for name, value in authored.items()))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def own_steps(
    entries: Iterable[tuple[int, ProfileRevision]], robot: str, bases: MutableMapping[str, str]
) -> Iterator[FleetStep]:
    """Yield the steps of the revisions in a robot's ledger, without other robots' steps.

    Args:
        entries: Entries from :meth:`LedgerReader.entries`.
        robot: Name of the robot.
        bases: Agent → base before the first entry; it is updated.
    """
    for number, revision in entries:
        cause = revision.cause
        if cause.cause == AUTHORED:
            bases[revision.agent] = base_of(cause.target)
            if not revision.layer and revision.profile == cause.target:
                continue  # The base says it.
        recorded = recorded_step(revision)
        if recorded is not None and recorded.robot == robot:
            yield recorded  # It came after the layer was forgotten elsewhere.
        if cause.cause == FORGOTTEN and cause.step and recorded is None:
            yield FleetStep(
                robot=robot,
                number=number,
                agent=revision.agent,
                layer=cause.step["layer"],
                base=bases[revision.agent],
                event=StepEvent.FORGET,
                kind=FeedbackKind.SET,
                target={},
                stamp=cause.step["stamp"],
            )
        event = _EVENTS.get(cause.cause)
        if event is None or (cause.cause == LAYER and cause.source == FLEET_SOURCE):
            continue
        is_feedback = event is StepEvent.FEEDBACK
        yield FleetStep(
            robot=robot,
            number=number,
            agent=revision.agent,
            layer=revision.layer,
            base=bases[revision.agent],
            event=event,
            kind=FeedbackKind(cause.kind) if is_feedback else FeedbackKind.SET,
            target=cause.target if is_feedback else revision.profile,
            weight=cause.weight if is_feedback else 1.0,
            changes=0 if is_feedback else cause.changes,
            stamp=revision.stamp,
        )


def recorded_step(revision: ProfileRevision) -> FleetStep | None:
    """Return the step that a revision of the ledger took in, usually from another robot."""
    fields = revision.cause.step
    if revision.cause.cause not in (FLEET, FORGOTTEN) or "robot" not in fields:
        return None
    event, kind = StepEvent(fields["event"]), FeedbackKind(fields["kind"])
    return FleetStep(**{**fields, "event": event, "kind": kind})


def read_step(fields: Any, space: SceneSpace, *, now: float) -> FleetStep:
    """Return a checked step from outside.

    Args:
        fields: Unchecked fields in the form of :meth:`FleetStep.fields`.
        space: Space of profiles.
        now: Wall time [s].

    Raises:
        Refused: ``BAD_STEP``, ``BAD_LAYER``, ``FROM_THE_FUTURE``, ``UNKNOWN_PARAMETER``, or as in
            :meth:`SceneSpace.vector`.
    """
    if not isinstance(fields, Mapping) or not fields.keys() == _FIELDS:
        raise _invalid("", f"expected the fields {', '.join(sorted(_FIELDS))}")
    robot, number = fields["robot"], fields["number"]
    if not isinstance(robot, str) or not ROBOT_NAME.fullmatch(robot):
        raise _invalid("", "expected a robot of 1 to 63 small letters, digits, '-' and '_'")
    if not _is_count(number) or not number:
        raise _invalid(robot, "its number is not a positive integer")
    what = f"{robot}/{number}"
    agent, layer, base, target = (fields[name] for name in ("agent", "layer", "base", "target"))
    if not isinstance(agent, str) or not 1 <= len(agent) <= LONGEST_NAME:
        raise _invalid(what, f"expected an agent of 1 to {LONGEST_NAME} characters")
    if not agent.isprintable() or not isinstance(layer, str):
        raise _invalid(what, "expected an agent and a layer without control characters")
    if not isinstance(base, str) or not _BASE.fullmatch(base):
        raise _invalid(what, "expected a base of 16 hexadecimal digits")
    if layer:
        checked_layer(layer)
    try:
        event, kind = StepEvent(fields["event"]), FeedbackKind(fields["kind"])
    except ValueError:
        raise _invalid(what, "its event or its kind is not known here") from None
    if event is not StepEvent.FEEDBACK and kind is not FeedbackKind.SET:
        raise _invalid(what, f"event '{event}' with kind {kind}, expected {FeedbackKind.SET}")
    least = 0 if event is StepEvent.FORGET else 1
    if not isinstance(target, Mapping) or not least <= len(target) <= MOST_PARAMETERS:
        raise _invalid(what, f"expected {least} to {MOST_PARAMETERS} values")
    if event is StepEvent.FORGET and not is_hidden(layer.partition("/")[2]):
        raise _invalid(what, "a forgotten layer is named openly, expected a hash")
    weight, stamp, changes = fields["weight"], fields["stamp"], fields["changes"]
    if not all(map(_is_number, (weight, stamp, *target.values()))):
        raise _invalid(what, "a value, its weight or its stamp is not a finite number")
    if not 0.0 <= weight <= MAX_WEIGHT or stamp < 0.0:
        raise _invalid(what, f"weight {weight:g} or stamp {stamp:g}, expected 0 to {MAX_WEIGHT:g}")
    if not _is_count(changes) or not _is_count(fields["arrival"]):
        raise _invalid(what, "its changes or its arrival are not a count")
    if stamp > now + LATEST_S:
        raise Refused(
            RefusalCode.FROM_THE_FUTURE,
            f"step {what}: made {stamp - now:.0f} s from now, expected {LATEST_S:g} s at most; "
            "look at the clocks of both robots",
        )
    for name in target:
        space.parameter(name, what=f"step {what}")
    space.vector(space.ordered(target), missing=True, what=f"step {what}")
    return FleetStep(
        robot=robot,
        number=number,
        agent=agent,
        layer=layer,
        base=base,
        event=event,
        kind=kind,
        target={name: float(value) for name, value in target.items()},
        weight=float(weight),
        changes=changes,
        stamp=float(stamp),
        arrival=fields["arrival"],
    )


@dataclass(frozen=True, kw_only=True)
class ReplayState:
    """Profile after the previous steps.

    Attributes:
        profile: The profile, in the order of the space; empty before it has begun.
        changes: Number of feedbacks that led to it, without those that set it.
        recent: Targets of the last feedbacks, newest last; as many as the rule uses.
    """

    profile: Vector = ()
    changes: int = 0
    recent: tuple[Vector, ...] = ()


_NOTHING = ReplayState()


class Forgettings:
    """Layers of an agent that any robot has forgotten; steps before that do not count."""

    def __init__(self) -> None:
        self._ends: dict[str, tuple[float, str, int]] = {}

    def add(self, step: FleetStep) -> None:
        """Record that a layer was forgotten; the latest time counts."""
        self._ends[step.layer] = max(step.key, self._ends.get(step.layer, step.key))

    def include(self, step: FleetStep) -> bool:
        """Return whether a step was made before its layer was forgotten."""
        if not step.layer or step.event is StepEvent.FORGET or not self._ends:
            return False
        end = self._ends.get(hidden_layer(step.layer))
        return end is not None and step.key < end


class Replay:
    """Profile of an agent or one of its layers after the steps of a fleet.

    Steps take effect in the order of their keys, so the profile depends only on the set of steps,
    not on the order of their arrival. The result after each step is kept, so a late step
    costs only the replay of the steps after it.
    """

    def __init__(self, agent: Agent, space: SceneSpace, robot: str) -> None:
        self._agent = agent
        self._space = space
        self._robot = robot
        self._rule = learning_step.parameter_rules(agent.learning, space)
        self._known: set[tuple[str, int]] = set()
        self._keys: list[tuple[float, str, int]] = []
        self._steps: list[FleetStep] = []
        self._states: list[ReplayState] = []

    def add(self, steps: Iterable[FleetStep]) -> None:
        """Add steps; known ones are skipped."""
        for step in steps:
            name = step.robot, step.number
            if name in self._known:
                continue
            self._known.add(name)
            place = bisect_left(self._keys, step.key)
            self._keys.insert(place, step.key)
            self._steps.insert(place, step)
            del self._states[place:]

    @property
    def state(self) -> ReplayState:
        """The profile after all steps."""
        for step in self._steps[len(self._states) :]:
            before = self._states[-1] if self._states else _NOTHING
            self._states.append(self._after(before, step))
        return self._states[-1] if self._states else _NOTHING

    def _after(self, state: ReplayState, step: FleetStep) -> ReplayState:
        if step.event is StepEvent.BEGIN and state.profile:
            return state
        target = self._space.ordered(step.target)
        authored = self._agent.authored
        if step.event is not StepEvent.FEEDBACK:
            whole = tuple(
                min(max(own if math.isnan(wanted) else wanted, one.low), one.high)
                for one, own, wanted in zip(self._rule, authored, target, strict=True)
            )
            return ReplayState(
                profile=whole, changes=step.changes, recent=self._recent_of(whole, step.changes)
            )
        profile = state.profile or authored
        weight = step.weight
        if step.robot != self._robot:
            weight *= self._agent.learning.weight(FLEET_SOURCE)
        rates = learning_step.effective_rates(
            self._rule, self._agent.entry.learning_rate, weight, state.changes
        )
        after = learning_step.apply_update(
            self._rule, step.kind, profile, target, rates, state.recent, authored
        )
        if step.kind is FeedbackKind.SET:
            return ReplayState(profile=after, changes=state.changes, recent=state.recent)
        asked = learning_step.requested(self._rule, step.kind, profile, target)
        recent = (*state.recent, asked)[-self._agent.learning.window :]
        return ReplayState(profile=after, changes=state.changes + 1, recent=recent)

    def _recent_of(self, profile: Vector, changes: int) -> tuple[Vector, ...]:
        """Return the targets that led to the profile that an undo restores; empty for none."""
        if changes == 0:
            return ()
        for state in reversed(self._states):
            if state.changes == changes and all(map(math.isclose, state.profile, profile)):
                return state.recent
        return ()


_FIELDS = frozenset(FleetStep.__dataclass_fields__)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _MOST


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _invalid(what: str, found: str) -> Refused:
    return Refused(RefusalCode.BAD_STEP, f"step{f' {what}' if what else ''}: {found}")
