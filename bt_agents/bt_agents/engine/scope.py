# SPDX-License-Identifier: Apache-2.0
"""What a name means at a moment of a run: inputs, tunables, outputs, scene, live scene, mood."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from bt_agents.language.expressions import Expression, MissingValue
from bt_agents.language.specs import (
    ListValue,
    Literal,
    MapValue,
    Plain,
    Reference,
    Text,
    Value,
)
from bt_agents.scene import Scene, SceneSpace, Vector


class Scope(Protocol):
    """Resolves names."""

    def lookup(self, name: str) -> Plain:
        """Return the value of a name.

        Raises:
            MissingValue: Nothing has given it a value yet, or the scene does not know it.
        """


@dataclass(kw_only=True)
class RunScope:
    """The names of one run; tunables and the live scene may change while it goes on.

    Attributes:
        space: The scene parameters.
        scene: As awarded.
        live: Returns the scene as it is now.
        profile: The agent's own vector.
        tunables: Current values by name, shared with whoever tunes them.
        blackboard: Outputs of leaves and what ``set`` wrote, private to the run.
    """

    space: SceneSpace
    scene: Scene
    live: Callable[[], Scene]
    profile: Vector
    tunables: Mapping[str, Plain]
    blackboard: dict[str, Plain] = field(default_factory=dict)

    def lookup(self, name: str) -> Plain:
        """Return the value of a name; see :class:`Scope`."""
        if name in self.tunables:
            return self.tunables[name]
        if name in self.blackboard:
            return self.blackboard[name]
        group, _, member = name.partition(".")
        if group == "scene":
            return _of_scene(self.scene, name, member)
        if group == "live":
            return _of_scene(self.live(), name, member)
        if name == "mood.change" and self.space.mood is not None:
            live, start = (s.get(self.space.mood) for s in (self.live(), self.scene))
            return _known(name, live - start)
        if group == "profile" and member in self.space.names:
            return self.profile[self.space.names.index(member)]
        raise MissingValue(name)


def _of_scene(scene: Scene, name: str, member: str) -> Plain:
    if member == "person":
        return scene.person
    try:
        return _known(name, scene.get(member))
    except KeyError:
        raise MissingValue(name) from None


def _known(name: str, value: float) -> float:
    if math.isnan(value):
        raise MissingValue(name)
    return value


@dataclass(frozen=True, kw_only=True)
class InputScope:
    """The names inside a subtree or a skill's binding: its inputs, then those around it.

    Attributes:
        inputs: Values as the caller wrote them; they mean what they mean to the caller.
        caller: Scope in which the inputs are evaluated.
    """

    inputs: Mapping[str, Value]
    caller: Scope

    def lookup(self, name: str) -> Plain:
        """Return the value of a name; see :class:`Scope`."""
        if name in self.inputs:
            return evaluate(self.inputs[name], self.caller)
        return self.caller.lookup(name)


@dataclass(frozen=True, kw_only=True)
class MessageScope:
    """Names of a message (``msg.data``, ``result.answer``) over those of the tree."""

    prefix: str
    message: Mapping[str, Plain]
    around: Scope

    def lookup(self, name: str) -> Plain:
        """Return the value of a name; see :class:`Scope`."""
        group, _, path = name.partition(".")
        if group != self.prefix:
            return self.around.lookup(name)
        return field_of(self.message, path, name)


def field_of(message: Mapping[str, Plain], path: str, name: str) -> Plain:
    """Return a field of a plain message by its dotted path; a number names an item of a list.

    Raises:
        MissingValue: There is no such field or item; it names ``name``.
    """
    value: Plain = message
    for part in path.split("."):
        if isinstance(value, Mapping) and part in value:
            value = value[part]
        elif isinstance(value, (list, tuple)) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            raise MissingValue(name)
    return value


def evaluate(value: Value, scope: Scope) -> Plain:
    """Return what a written value means now.

    Raises:
        MissingValue: A name in it has no value.
    """
    match value:
        case Literal():
            return value.value
        case Reference():
            return scope.lookup(value.name)
        case Text():
            return "".join(
                part if isinstance(part, str) else spoken(scope.lookup(part.name))
                for part in value.parts
            )
        case ListValue():
            return tuple(evaluate(item, scope) for item in value.items)
        case MapValue():
            return {key: evaluate(item, scope) for key, item in value.items.items()}


def holds(condition: Expression, scope: Scope) -> bool:
    """Return whether a condition is true now; see :meth:`Expression.evaluate` for its errors."""
    return condition.evaluate(scope.lookup) is True


def spoken(value: Plain) -> str:
    """Return a value as it stands inside a text: ``2`` for 2.0, ``yes`` for true."""
    match value:
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:g}"
        case None:
            return ""
        case _:
            return str(value)
