# SPDX-License-Identifier: Apache-2.0
"""Values of the names of conditions: scene, live scene, mood, profile, clock, person."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

from bt_agents_core.local_time import LocalTime
from bt_agents_language.expression.expression_values import Lookup
from bt_agents_language.expression.expressions import Expression, MissingValue, StaleValue
from bt_agents_language.expression.operators import HOUR


class SceneLike(Protocol):
    """Part of a scene that conditions name; see :class:`~bt_agents_core.scene.Scene`."""

    @property
    def person(self) -> bool:
        """True if a person is present."""

    @property
    def stale_s(self) -> float:
        """Silence of the scene layer, if too long for the values to be current; else 0 [s]."""

    def get(self, name: str) -> float:
        """Return the value of a parameter, NaN if unknown.

        Raises:
            KeyError: There is no such parameter.
        """


SceneT = TypeVar("SceneT", bound=SceneLike)


@dataclass(frozen=True, kw_only=True)
class SceneFacts:
    """Scene as conditions name it; some of its values may count as unknown."""

    person: bool
    values: Mapping[str, float]
    stale_s: float = 0.0

    def get(self, name: str) -> float:
        """Return the value of a parameter; see :class:`SceneLike`."""
        return self.values[name]


def resolve(
    name: str,
    scene: SceneLike,
    live: Callable[[], SceneT] | None = None,
    mood_change: Callable[[SceneT], float] | None = None,
    profile: Callable[[str], float] | None = None,
    clock: Callable[[], LocalTime] | None = None,
    person: Callable[[str], bool | float | str] | None = None,
) -> bool | float | str:
    """Return the value of a name such as ``scene.age`` or ``mood.change``.

    Args:
        name: The name.
        scene: Scene as awarded, or scene of a query.
        live: Returns the current scene; None if conditions do not name it.
        mood_change: Mood of a live scene minus that at the start, NaN if unknown.
        profile: Returns the agent's own value of a parameter.
        clock: Returns the local time; None if unknown.
        person: Returns facts about the person; None if conditions do not name them.

    Raises:
        MissingValue: The name has no value here; a stale live scene raises :class:`StaleValue`.
    """
    group, _, member = name.partition(".")
    try:
        if group == "scene":
            return _value(name, scene, member)
        if live is not None:
            if name == "live.stale":
                return live().stale_s > 0.0
            if group == "live":
                return _value(name, _fresh(name, live()), member)
            if name == "mood.change" and mood_change is not None:
                return _known(name, mood_change(_fresh(name, live())))
        if group == "profile" and profile is not None:
            return profile(member)
        if group == "person" and person is not None:
            return person(member)
        if name == HOUR and clock is not None:
            return clock().hour
        if name == "clock.weekday" and clock is not None:
            return clock().weekday
    except KeyError:
        raise MissingValue(name) from None
    raise MissingValue(name)


def surely_true(condition: Expression, lookup: Lookup) -> bool:
    """Return whether a condition is true; a condition with a missing value is not.

    Raises:
        Undecided: It is neither true nor false, and no value is missing.
    """
    try:
        return condition.is_true(lookup)
    except MissingValue:
        return False


def _fresh(name: str, live: SceneT) -> SceneT:
    if live.stale_s:
        raise StaleValue(name, live.stale_s)
    return live


def _value(name: str, scene: SceneLike, member: str) -> bool | float:
    return scene.person if member == "person" else _known(name, scene.get(member))


def _known(name: str, value: float) -> float:
    if math.isnan(value):
        raise MissingValue(name)
    return value
