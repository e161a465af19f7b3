# SPDX-License-Identifier: Apache-2.0
"""Values of names during a run, and the fields of nodes that are evaluated with them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, cast

from bt_agents_core.errors import Refused
from bt_agents_core.field_path import NoSuchField, item_of, value_at
from bt_agents_core.field_types import FieldType, Plain
from bt_agents_core.local_time import LocalTime
from bt_agents_core.mood import MoodStart
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, SceneSpace, Vector, check_value, mood_of
from bt_agents_core.stop_cause import Cancellation
from bt_agents_core.text import quote
from bt_agents_language.expression import quantities
from bt_agents_language.expression.expression_values import EvaluationError, described
from bt_agents_language.expression.expressions import Expression, MissingValue, StaleValue
from bt_agents_language.expression.name_resolution import resolve
from bt_agents_language.model.specs import (
    Computed,
    ListValue,
    Literal,
    MapValue,
    NodeSpec,
    Place,
    Reference,
    Text,
    Value,
    Variants,
)
from bt_agents_language.nodes.node_type import FOREVER

_LONGEST_JSON = 100_000
_LONGEST_TEXT = 100_000
_MOST_NAMES = 4
_NOTHING = object()
QUANTITIES = (FieldType.DURATION, FieldType.LENGTH, FieldType.ANGLE)
"""Types of numbers with units."""


class ValueSource(Protocol):
    """Looks up the values of names."""

    def lookup(self, name: str) -> Plain:
        """Return the value of a name.

        Raises:
            MissingValue: It has no value yet, or the scene does not know it.
        """


class Scope(ValueSource, Protocol):
    """Names of a tree, some written by its nodes."""

    def declare(self, names: Iterable[str]) -> None:
        """Declare names that a node of the tree writes; called while the tree is built."""

    def write(self, name: str, value: Plain) -> bool:
        """Assign a value to a name; return whether it had another value or none before."""


@dataclass(kw_only=True)
class RunScope:
    """The names of one run; tunables and the live scene may change during it.

    Attributes:
        scene: The scene as awarded.
        live: Returns the current scene, or the last one marked as stale.
        profile: The agent's own vector.
        tunables: Current values by name, shared with the host that tunes them.
        agent: Name of the agent.
        host: Fully qualified name of the node that ticks the tree; empty without one.
        clock: Returns the local time; None where it is unknown.
        cancellation: Who stopped the run and why; None while unknown.
        told: Values that nodes have put into the scene or remembered about the person, by full
            name, and that ``scene`` and the live scene do not have yet.
        blackboard: Outputs of leaves and values of ``set``, private to the run; values of subtrees
            are not included.
        mood_start: Reference of ``mood.change``.
    """

    space: SceneSpace
    scene: Scene
    live: Callable[[], Scene]
    profile: Vector
    tunables: Mapping[str, Plain]
    agent: str = ""
    host: str = ""
    clock: Callable[[], LocalTime] | None = None
    cancellation: Cancellation | None = None
    told: dict[str, Plain] = field(default_factory=dict)
    blackboard: dict[str, Plain] = field(default_factory=dict)
    mood_start: MoodStart = field(init=False)

    def __post_init__(self) -> None:
        self.mood_start = MoodStart(self.scene, self.space)

    def lookup(self, name: str) -> Plain:
        if name in self.blackboard:
            return self.blackboard[name]
        return self.read_only_value(name)

    def declare(self, names: Iterable[str]) -> None:
        """Do nothing: written names hide no others here."""

    def write(self, name: str, value: Plain) -> bool:
        return _assign(self.blackboard, name, value)

    def tell(self, name: str, value: Plain) -> bool:
        """Assign a value to a name of the scene or the person; return as :meth:`write`."""
        return _assign(self.told, name, value)

    def read_only_value(self, name: str) -> Plain:
        """Return the value of a name that no node writes; see :class:`ValueSource`."""
        if name in self.tunables:
            return self.tunables[name]
        if name == "cancel.by" and self.cancellation is not None:
            return self.cancellation.by
        if name == "cancel.reason" and self.cancellation is not None:
            return self.cancellation.reason
        if name in self.told:
            return self.told[name]
        if name.startswith("run."):
            return self._of_run(name)
        return resolve(
            name,
            self.scene,
            self.live,
            lambda live: mood_of(live, self.space) - self.mood_start.value,
            self._own_value,
            self.clock,
            lambda member: self.live().of_person(member),
        )

    def _of_run(self, name: str) -> Plain:
        match name:
            case "run.agent":
                return self.agent
            case "run.host":
                return self.host
            case "run.person":
                return self.scene.person_id or self.live().person_id
            case "run.urgency":
                return int(self.scene.urgent)
        raise MissingValue(name)

    def _own_value(self, parameter: str) -> float:
        names = self.space.profiles.names
        if parameter not in names:
            raise KeyError(parameter)
        return self.profile[names.index(parameter)]


@dataclass(frozen=True, kw_only=True)
class BindingNames:
    """The names inside the binding of a skill: its inputs, its place, then the tree's names."""

    inputs: Mapping[str, Plain]
    around: ValueSource
    place: Place | None = None

    def lookup(self, name: str) -> Plain:
        if name in self.inputs:
            return self.inputs[name]
        group, _, member = name.partition(".")
        if self.place is not None and group == "place":
            return self.place.values[member]
        return self.around.lookup(name)


@dataclass(kw_only=True)
class SubtreeScope:
    """The names inside a subtree: its inputs, the names it writes, and read-only names of the run.

    Attributes:
        inputs: Values as the caller wrote them; they are evaluated in the caller's names.
        caller: The caller's names.
        run: Source of tunables, scene, live scene, mood and profile.
        own: Names that nodes of the subtree write; see :meth:`declare`.
        written: The names that got a value since its start.
    """

    inputs: Mapping[str, Value]
    caller: ValueSource
    run: RunScope
    own: set[str] = field(default_factory=set)
    written: dict[str, Plain] = field(default_factory=dict)

    def lookup(self, name: str) -> Plain:
        if name in self.written:
            return self.written[name]
        if name in self.inputs:
            return evaluate(self.inputs[name], self.caller)
        if name in self.own:
            # A tunable of the same name belongs to another file.
            raise MissingValue(name)
        return self.run.read_only_value(name)

    def declare(self, names: Iterable[str]) -> None:
        """Declare names that a node of the subtree writes; they hide names of the run."""
        self.own.update(names)

    def write(self, name: str, value: Plain) -> bool:
        return _assign(self.written, name, value)


def _assign(values: dict[str, Plain], name: str, value: Plain) -> bool:
    """Assign a value to a name; return as :meth:`Scope.write`."""
    changes = values.get(name, _NOTHING) != value
    values[name] = value
    return changes


@dataclass(frozen=True, kw_only=True)
class MessageNames:
    """Names of a message (``msg.data``, ``result.answer``), before the names of the tree."""

    prefix: str
    message: Mapping[str, Plain]
    around: ValueSource

    def lookup(self, name: str) -> Plain:
        group, _, path = name.partition(".")
        if group != self.prefix:
            return self.around.lookup(name)
        return field_of(self.message, path, name)


def field_of(message: Mapping[str, Plain], path: str, name: str) -> Plain:
    """Return a field of a plain message by its dotted path; a number selects a list item.

    After a ``#`` the path continues inside the JSON text of the field.

    Raises:
        MissingValue: The field or item does not exist; the error names ``name``.
        Refused: ``NOT_JSON``.
    """
    outer, _, inner = path.partition("#")
    value = _value_at(message, outer, name)
    return _value_at(_parsed(value, name), inner, name) if inner else value


def _value_at(value: Plain, path: str, name: str) -> Plain:
    try:
        return cast(Plain, value_at(value, path, item_of))
    except NoSuchField:
        raise MissingValue(name) from None


def _parsed(text: Plain, name: str) -> Plain:
    if not isinstance(text, str) or len(text) > _LONGEST_JSON:
        raise Refused(
            RefusalCode.NOT_JSON,
            f"'{name}' needs a JSON text of at most {_LONGEST_JSON:,} characters",
        )
    try:
        return cast(Plain, json.loads(text, parse_constant=_refuse_constant))
    except (ValueError, RecursionError) as error:
        raise Refused(RefusalCode.NOT_JSON, f"'{name}' needs a JSON text, but: {error}") from None


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is not a number")


def evaluate(value: Value, names: ValueSource) -> Plain:
    """Return the current result of a written value.

    Raises:
        MissingValue: A name in it has no value.
        EvaluationError: An expression in it cannot be evaluated.
        Refused: ``TOO_LONG``; a text that repeats itself would fill the memory.
    """
    match value:
        case Literal():
            return value.value
        case Reference():
            return names.lookup(value.name)
        case Computed():
            return _computed(value, names)
        case Text():
            return _bounded("".join(_as_text(part, names) for part in value.parts))
        case Variants():
            raise AssertionError("variants are picked before they are evaluated")
        case ListValue():
            return tuple(evaluate(item, names) for item in value.items)
        case MapValue():
            return {key: evaluate(item, names) for key, item in value.items.items()}


def _bounded(text: str) -> str:
    if len(text) > _LONGEST_TEXT:
        raise Refused(
            RefusalCode.TOO_LONG,
            f"the text has {len(text):,} characters, expected at most {_LONGEST_TEXT:,}",
        )
    return text


def explain_false(condition: Expression, names: ValueSource, *, verb: str = "not so") -> str:
    """Return a text that a condition is not true, with the current values of its names.

    For example ``not so: answer == 'yes' (answer is 'no')``. It shows only the first of many
    names, and no name that is the whole condition and false.
    """
    explanation = f"{verb}: {condition.text}"
    mentioned = list(dict.fromkeys(mention.name for mention in condition.mentions))
    constant = dict(condition.texts)
    values = {
        name: f"is {quote(constant[name])}" if name in constant else _current(name, names)
        for name in mentioned[:_MOST_NAMES]
    }
    if values == {condition.text: "is false"}:
        return explanation
    parts = [f"{name} {value}" for name, value in values.items()]
    parts += ["…"] * (len(mentioned) > _MOST_NAMES)
    return f"{explanation} ({', '.join(parts)})" if parts else explanation


def _current(name: str, names: ValueSource) -> str:
    """Return the state of a name: ``is 'yes'``, ``is 2``, ``has no value``."""
    try:
        value = names.lookup(name)
    except StaleValue:
        return "is stale"
    except MissingValue:
        return "has no value"
    except (Refused, EvaluationError):
        return "cannot be told"
    match value:
        case str():
            return f"is {quote(value)}"
        case int() | float() if not isinstance(value, bool) and -1e15 < value < 1e15:
            return f"is {round(value, 3):.15g}"
    return f"is {described(value).removeprefix('the number ')}"


def _computed(value: Computed, names: ValueSource) -> Plain:
    # Expressions on plain values return plain values.
    return cast(Plain, value.expression.evaluate(names.lookup))


def _as_text(part: str | Value, names: ValueSource) -> str:
    match part:
        case str():
            return part
        case Reference():
            return format_value(names.lookup(part.name), part.type)
        case Computed():
            return format_value(_computed(part, names), FieldType.ANY)
    return format_value(evaluate(part, names), FieldType.ANY)


def format_value(value: Plain, field_type: FieldType) -> str:
    """Format a value for a text: ``2`` for 2.0, ``yes`` for true, ``1.5 min``."""
    match value:
        case bool():
            return "yes" if value else "no"
        case int() | float() if field_type in QUANTITIES:
            return quantities.format_quantity(value, field_type)
        case float():
            return f"{value:g}"
        case None:
            return ""
        case tuple() | list():
            return ", ".join(format_value(item, field_type) for item in value)
        case _:
            return str(value)


@dataclass(frozen=True, kw_only=True)
class NodeFields:
    """The fields of one node; each call evaluates them, because names change during a run."""

    spec: NodeSpec
    names: ValueSource

    def __contains__(self, name: str) -> bool:
        return name in self.spec.fields

    def value(self, name: str) -> Plain:
        """Return the current result of a value.

        Raises:
            MissingValue: A name in it has no value.
            EvaluationError: An expression in it cannot be evaluated.
        """
        value = self.spec.fields[name]
        assert not isinstance(value, Expression)
        return evaluate(value, self.names)

    def condition(self, name: str) -> Expression:
        """Return a condition."""
        value = self.spec.fields[name]
        assert isinstance(value, Expression)
        return value

    def is_true(self, name: str) -> bool:
        """Return whether a condition is true now; see :meth:`Expression.is_true`."""
        return self.condition(name).is_true(self.names.lookup)

    def explain_false(self, name: str, *, verb: str = "not so") -> str:
        """Return a text that a condition is not true, with the values of its names."""
        return explain_false(self.condition(name), self.names, verb=verb)

    def constant(self, name: str, default: Plain = None) -> Plain:
        """Return a constant value; ``default`` if the field is missing."""
        value = self.spec.fields.get(name)
        return value.value if isinstance(value, Literal) else default

    def number(self, name: str) -> float:
        """Return a finite number of at least 0.

        Raises:
            Refused: ``NOT_A_NUMBER`` unless it is finite and at least 0. Else as :meth:`value`.
        """
        return self._from_zero(name, RefusalCode.NOT_A_NUMBER, "a number from 0 on")

    def seconds(self, name: str) -> float:
        """Return a duration [s]; 0 if the field is missing.

        Raises:
            Refused: ``NOT_A_DURATION`` unless it is finite and at least 0. Else as
                :meth:`value`.
        """
        if name not in self.spec.fields:
            return 0.0
        return self._from_zero(name, RefusalCode.NOT_A_DURATION, "a time such as '5 s'")

    def count(self, name: str) -> int | None:
        """Return an integer of at least 1; None for ``forever``.

        Raises:
            Refused: ``NOT_A_COUNT``; it is neither. Else as :meth:`value`.
        """
        value = self.value(name) if name in self.spec.fields else FOREVER
        if value == FOREVER:
            return None
        number = finite(value)
        if number is None or number < 1 or not number.is_integer():
            raise Refused(
                RefusalCode.NOT_A_COUNT,
                f"'{name}' is {described(value)}, expected a whole number from 1 on",
            )
        return int(number)

    def _from_zero(self, name: str, code: RefusalCode, expected: str) -> float:
        value = self.value(name)
        number = finite(value)
        if number is None or number < 0:
            raise Refused(code, f"'{name}' is {described(value)}, expected {expected}")
        return number


def scene_value(space: SceneSpace, name: str, value: Plain, what: str) -> float:
    """Return a value for a scene parameter.

    Raises:
        Refused: ``UNKNOWN_PARAMETER``, ``NOT_A_NUMBER`` or ``OUT_OF_RANGE``.
    """
    parameter = space.parameter(name, what=what)
    number = finite(value)
    if number is None:
        raise Refused(
            RefusalCode.NOT_A_NUMBER,
            f"{what}: {name} is {described(value)}, expected a number between "
            f"{parameter.minimum:g} and {parameter.maximum:g}",
        )
    return check_value(parameter, number, what=what)


def finite(value: Plain) -> float | None:
    """Return the value if it is a finite number, else None."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
