# SPDX-License-Identifier: Apache-2.0
"""Specifications: frozen data of checked files, for building the engine and the nodes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, Self, TypeVar

from bt_agents_core.diagnostic import Diagnostic, Position
from bt_agents_core.feedback import LearningRule
from bt_agents_core.field_types import BindingKind, FieldType, Plain
from bt_agents_core.scene import Vector
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.mood_rule import MoodRule

NOTHING: Mapping[str, Any] = {}
"""Mapping shared by all nodes without fields or outputs, to save space."""


CLEAN_UP_S = 3.0
"""Default time for ``on_cancel`` of an agent [s]."""

SHORTEST_CLEAN_UP_S, MOST_CLEAN_UP_S = 0.5, 10.0
"""Shortest and longest time for ``on_cancel`` of an agent [s]."""


def _nothing() -> Mapping[str, Any]:
    return NOTHING


@dataclass(frozen=True, kw_only=True, slots=True)
class Literal:
    """A value as written, in SI units; the type of its place decides its unit in texts."""

    value: Plain
    type: FieldType = field(default=FieldType.ANY, compare=False)


@dataclass(frozen=True, kw_only=True, slots=True)
class Reference:
    """``${name}``: the value of a name when it is needed; its type formats it in a text."""

    name: str
    type: FieldType = field(default=FieldType.ANY, compare=False)


@dataclass(frozen=True, kw_only=True, slots=True)
class Computed:
    """``${age + 1}``: the value of an expression when it is needed."""

    expression: Expression


@dataclass(frozen=True, kw_only=True, slots=True)
class Text:
    """Text with names inside: ``Hello ${who}.``."""

    parts: tuple[str | Reference | Computed | Variants, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Variants:
    """Several texts; a skill takes another one each time."""

    texts: tuple[Literal | Reference | Text, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class ListValue:
    """A list of values."""

    items: tuple[Value, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class MapValue:
    """A mapping of values, for example the goal of an action."""

    items: Mapping[str, Value]


Value = Literal | Reference | Computed | Text | Variants | ListValue | MapValue


@dataclass(frozen=True, kw_only=True)
class FieldSpec:
    """One typed input or output of a skill or subtree."""

    name: str
    type: FieldType
    required: bool = True
    default: Plain = None
    description: str = ""

    @cached_property
    def default_value(self) -> Literal:
        """Value in a node that does not write the field."""
        return Literal(value=self.default)


@dataclass(frozen=True, kw_only=True)
class Timeouts:
    """Timeouts of a server, on a clock that never stops.

    Attributes:
        server_s: Time to be found, or to return after leaving the graph [s].
        accept_s: Time to accept or reject a goal [s].
        result_s: Time from the acceptance of a goal to its result, or from a request to its
            answer [s]; None sets no limit for a goal and :data:`REPLY_LIMIT_S` for a request.
    """

    server_s: float = 3.0
    accept_s: float = 3.0
    result_s: float | None = None


REPLY_LIMIT_S = 10.0
"""Default time for a service to answer [s]."""


@dataclass(frozen=True, kw_only=True)
class HeartbeatSpec:
    """Heartbeat of a server; if silent for ``within_s`` [s], the server counts as dead."""

    topic: str
    type: str
    within_s: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ErrorCodeSpec:
    """Error code in a result, which reports a failure whatever ROS reports for the goal.

    Attributes:
        field: Path of the code in the result or response.
        success: The codes that mean success.
        message: Path of the reason in words; empty if there is none.
    """

    field: str
    success: tuple[Plain, ...] = (0,)
    message: str = ""


@dataclass(frozen=True, kw_only=True)
class Place:
    """A named place, as a pose on the floor.

    Attributes:
        frame: Name of the frame of the pose.
        x: Position along the first axis of the frame [m].
        y: Position along the second axis [m].
        heading: Direction of the robot there, counterclockwise from the first axis [rad].
    """

    frame: str = "map"
    x: float
    y: float
    heading: float = 0.0

    @cached_property
    def values(self) -> Mapping[str, Plain]:
        """Values for bindings: the fields, and the heading as a quaternion."""
        return {
            "frame": self.frame,
            "x": self.x,
            "y": self.y,
            "heading": self.heading,
            "orientation_z": math.sin(self.heading / 2.0),
            "orientation_w": math.cos(self.heading / 2.0),
        }


@dataclass(frozen=True, kw_only=True)
class Binding:
    """Connection of a skill to the robot.

    Attributes:
        name: ROS name, relative unless it starts with a slash.
        type: ROS type, for example ``bt_agents_interfaces/action/Say``.
        fields: Goal, request or message; its references name inputs of the skill.
        outputs: Output name → field of the result or response, for example ``answer``.
        feedback: Output name → field of the feedback, which updates it during the action.
        succeed_when: Condition over ``result.*``; None succeeds whenever ROS reports success.
        heartbeat: Heartbeat that reveals its death; None relies on the graph and the timeouts.
        error_code: Error code in the result; None for none.
        place: Input that names a place for ``place.*``; empty for none.
        places: The places by name.
    """

    kind: BindingKind
    name: str
    type: str
    fields: MapValue
    outputs: Mapping[str, str] = field(default_factory=dict)
    feedback: Mapping[str, str] = field(default_factory=dict)
    succeed_when: Expression | None = None
    timeouts: Timeouts = field(default_factory=Timeouts)
    heartbeat: HeartbeatSpec | None = None
    error_code: ErrorCodeSpec | None = None
    place: str = ""
    places: Mapping[str, Place] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class SkillSpec:
    """Skill: a word for authors, and its effect on this robot.

    Attributes:
        name: The node key.
        main: Input that a scalar sets; None if there is none.
        outputs: Names that later nodes may use.
        binding: Its binding; None if no robot with installed ROS types has one.
        unoffered: Why there is no binding, in words; empty if there is one.
        robots: Robot with a binding → why that is unusable, in words; empty if usable.
    """

    name: str
    description: str
    main: str | None
    inputs: tuple[FieldSpec, ...]
    outputs: tuple[FieldSpec, ...]
    binding: Binding | None
    position: Position
    unoffered: str = ""
    robots: Mapping[str, str] = field(default_factory=_nothing)

    @cached_property
    def input_names(self) -> tuple[str, ...]:
        """The names of its inputs."""
        return tuple(one.name for one in self.inputs)

    @cached_property
    def required(self) -> tuple[str, ...]:
        """Names of the required inputs."""
        return tuple(one.name for one in self.inputs if one.required)

    @cached_property
    def main_is_text(self) -> bool:
        """True if its main input is a text."""
        return any(one.name == self.main and one.type is FieldType.TEXT for one in self.inputs)


@dataclass(frozen=True, kw_only=True, slots=True)
class NodeSpec:
    """Node of a tree; a decorator is a node around the node that it decorates.

    Attributes:
        path: Stable position in the tree, for example ``tree/0.say`` or ``tree/1.ask@timeout``.
        kind: Node key or decorator: ``sequence``, ``timeout``, ``say``.
        fields: Values and conditions by field name.
        children: Children in order; for a decorator, the decorated node comes first.
        skill: Set when ``kind`` is a skill.
        outputs: Assigned name → source of its value: a field path of the result or message, or a
            name inside a subtree.
        feedback: Name assigned while the node runs → field path of its action's feedback.
        plugin: Class of a node from a plug-in.
    """

    path: str
    position: Position
    kind: str
    name: str
    fields: Mapping[str, Value | Expression] = field(default_factory=_nothing)
    children: tuple[NodeSpec, ...] = ()
    skill: SkillSpec | None = None
    outputs: Mapping[str, str] = field(default_factory=_nothing)
    feedback: Mapping[str, str] = field(default_factory=_nothing)
    plugin: type | None = None

    @property
    def variants(self) -> tuple[Variants, ...]:
        """Its variants, if any; it takes another one each time."""
        found: list[Variants] = []
        for value in self.fields.values():
            parts = value.parts if isinstance(value, Text) else (value,)
            found += [part for part in parts if isinstance(part, Variants)]
        return tuple(found)

    def moved(self, path: str, children: tuple[NodeSpec, ...]) -> NodeSpec:
        """Return the node at another path, with other children."""
        # ``replace`` would take three times as long, and each use of a subtree is moved.
        return NodeSpec(
            path=path,
            position=self.position,
            kind=self.kind,
            name=self.name,
            fields=self.fields,
            children=children,
            skill=self.skill,
            outputs=self.outputs,
            feedback=self.feedback,
            plugin=self.plugin,
        )


class _Parent(Protocol):
    @property
    def children(self) -> tuple[Self, ...]: ...


_Node = TypeVar("_Node", bound=_Parent)


def iter_nodes(root: _Node) -> Iterator[_Node]:
    """Yield a node and all nodes below it, parents before children."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        yield node
        if node.children:
            waiting += reversed(node.children)


@dataclass(frozen=True, kw_only=True)
class SubtreeSpec:
    """Subtree that nodes can call.

    Attributes:
        inputs: Typed inputs, set with ``with``.
        outputs: Names that the caller may use afterwards.
        body: Its tree with its own subtrees expanded; None while its file is being read.
        complete: False if its declaration has errors, so that calls cannot be checked.
    """

    name: str
    inputs: tuple[FieldSpec, ...]
    outputs: tuple[FieldSpec, ...]
    body: NodeSpec | None
    position: Position
    complete: bool = True
    description: str = ""


@dataclass(frozen=True, kw_only=True)
class UnusedInput:
    """Input of a subtree that its tree does not use."""

    name: str
    subtree: str
    position: Position


@dataclass(frozen=True, kw_only=True)
class Tunable:
    """Value of a tree that may change while it runs; durations are in seconds.

    Attributes:
        minimum: Smallest value of a number, integer or duration; None for texts and booleans.
        maximum: Largest value.
        step: Distance between allowed values, from ``minimum`` on; 0 allows all.
    """

    name: str
    type: FieldType
    default: bool | int | float | str
    minimum: float | None
    maximum: float | None
    step: float
    description: str
    position: Position


@dataclass(frozen=True, kw_only=True)
class AgentSpec:
    """One agent file.

    Attributes:
        learning: How feedback moves the profile, with the learning rate as the usual step.
        weights: Parameter → its weight for this agent in weighted distances; without an entry,
            the weight in the scene file.
        clean_up_s: Time for ``on_cancel`` [s].
        names_cancellation: Whether ``on_cancel`` names who stopped the run, or why.
        unoffered: Used skills that no robot offers here, each with the reason; with any, the agent
            does not bid.
        unused_inputs: Inputs of its own subtrees.
        warnings: What its reader found legal, but rarely meant.
        language: Its own language; empty for the language of the robot.
    """

    name: str
    title: str
    description: str
    tags: tuple[str, ...]
    profile: Vector
    learning_rate: float
    requires: Expression | None
    tunables: tuple[Tunable, ...]
    rules: tuple[MoodRule, ...]
    tree: NodeSpec
    on_cancel: NodeSpec | None
    file: str
    learning: LearningRule = field(default_factory=LearningRule)
    weights: Mapping[str, float] = field(default_factory=dict)
    clean_up_s: float = CLEAN_UP_S
    names_cancellation: bool = False
    unoffered: tuple[str, ...] = ()
    unused_inputs: tuple[UnusedInput, ...] = ()
    warnings: tuple[Diagnostic, ...] = ()
    language: str = ""


@dataclass(frozen=True, kw_only=True)
class SceneChange:
    """Something that changes during a scripted visit.

    Attributes:
        after_s: Time since the agent's run started [s].
        person: Whether the person is there now; None for unchanged.
    """

    after_s: float
    values: Mapping[str, float]
    person: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Visit:
    """Scripted scene, with the actions of the person.

    Attributes:
        person: False for a thing that only looks like an interaction.
        values: Measured scene parameters; the others are missing.
        changes: In order of time.
        answers: Word in a question → answer; the first that fits counts.
        buttons: Topic of a button → words that the robot says or shows before it is pressed.
        urgent: True may stop a running tree at once if new scenes preempt.
        name: Name of the person; empty if unknown.
    """

    label: str
    person: bool
    values: Mapping[str, float]
    changes: tuple[SceneChange, ...] = ()
    answers: Mapping[str, str] = field(default_factory=dict)
    buttons: Mapping[str, str] = field(default_factory=dict)
    urgent: bool = False
    name: str = ""


@dataclass(frozen=True, kw_only=True)
class Script:
    """A list of visits, for the demo and for experiments."""

    title: str
    visits: tuple[Visit, ...]
