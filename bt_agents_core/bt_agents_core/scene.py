# SPDX-License-Identifier: Apache-2.0
"""Scene parameters, vectors and scenes, with the only validator of incoming vectors."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import FieldType
from bt_agents_core.person_facts import Fact
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import format_known

Vector = tuple[float, ...]
"""Values of all scene parameters, in the order of the space; NaN marks a missing one."""

MISSING = math.nan

MAX_WEIGHT = 100.0
"""Largest weight of a parameter or a source of feedback; most weigh 1."""

MAX_VALUE = 1e15
"""Largest limit of a range: numbers beyond it get coarse, and their squares overflow."""

MIN_WIDTH = 1e-9
"""Smallest width of the range of a scene parameter; distances are divided by it."""

AGAIN = "+again"
"""Suffix of the id of a scene that a restarted market announces again by itself."""

_AWARDED = re.compile(r"\+award\d+$")
_FOLLOW_UP = re.compile(r"\+[0-9]+\Z")


class Origin(IntEnum):
    """Origin of a value in a scene; the numbers match ``SceneValue.msg``."""

    MISSING = 0
    MEASURED = 1
    GIVEN = 2
    ESTIMATED = 3
    DEFAULT = 4
    TOLD = 5


Labels = tuple[tuple[float, str], ...]
"""Values of a scene parameter, each with a word."""


def nearest_label(labels: Labels, value: float) -> str:
    """Return the word for the nearest value, the smaller of two; empty if there are no labels."""
    return min(labels, key=lambda one: (abs(one[0] - value), one[0]), default=(value, ""))[1]


@dataclass(frozen=True, kw_only=True)
class SceneParameter:
    """One named dimension of scenes, and of profiles unless it is left out there.

    Attributes:
        minimum: Smallest value, in the parameter's own unit.
        default: Value in the range that stands for "nothing special"; never used as a measurement.
        labels: Words for some values, for example ``{1.0: "child"}``.
        weight: Its weight in weighted distances, 0 or more.
        assumed: Value in a scene with a person if it is unknown; None for missing.
        unattended: Value in a scene without persons if it is not measured; None for missing.
        profiled: False if profiles do not have it, so that it counts in no distance.
    """

    name: str
    minimum: float
    maximum: float
    default: float
    description: str = ""
    labels: Mapping[float, str] = field(default_factory=dict)
    weight: float = 1.0
    assumed: float | None = None
    unattended: float | None = None
    profiled: bool = True

    @property
    def ignorance(self) -> float:
        """Standard deviation of a value if only its range is known.

        It belongs to the uniform distribution: (max − min) / √12.
        """
        return (self.maximum - self.minimum) / math.sqrt(12.0)

    def unknown(self, *, met: bool) -> SceneValue:
        """Return the value for a scene if it is unknown, with or without a person ``met``."""
        if met and self.assumed is not None:
            return SceneValue(
                name=self.name,
                value=self.assumed,
                origin=Origin.DEFAULT,
                std=self.ignorance,
                confidence=0.0,
                source="default",
            )
        if not met and self.unattended is not None:
            return SceneValue(
                name=self.name,
                value=self.unattended,
                origin=Origin.DEFAULT,
                source="nobody is there",
            )
        return SceneValue.missing(self.name)

    def clamp(self, value: float) -> float:
        """Return ``value`` moved into the range; NaN stays NaN."""
        return value if math.isnan(value) else min(max(value, self.minimum), self.maximum)


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneValue:
    """One value of a scene; ``value`` is NaN exactly when ``origin`` is ``MISSING``.

    Two missing values are equal, although two NaNs are not.

    Attributes:
        value: In the unit of the parameter.
        age_s: Time since the reading; 0 when given, NaN when missing [s].
        std: Standard deviation in the unit of the parameter; 0 when exact or not stated, NaN when
            missing.
        confidence: 0..1 as the sources state it; 1 when not stated, 0 when missing.
        source: Its source in words; may be empty.
    """

    name: str
    value: float
    origin: Origin
    age_s: float = 0.0
    std: float = 0.0
    confidence: float = 1.0
    source: str = ""

    @property
    def observed(self) -> bool:
        """True for a measured, given or told value, not for an estimated or assumed one."""
        return self.origin in (Origin.MEASURED, Origin.GIVEN, Origin.TOLD)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SceneValue) and self._comparable == other._comparable

    def __hash__(self) -> int:
        return hash(self._comparable)

    @property
    def _comparable(self) -> tuple[object, ...]:
        numbers = (self.value, self.age_s, self.std, self.confidence)
        return (
            self.name,
            self.origin,
            self.source,
            *(None if math.isnan(number) else number for number in numbers),
        )

    @classmethod
    def missing(cls, name: str) -> SceneValue:
        """Return the missing value of a parameter."""
        return cls(
            name=name,
            value=MISSING,
            origin=Origin.MISSING,
            age_s=math.nan,
            std=math.nan,
            confidence=0.0,
        )


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The vector that describes an interaction, with the origin of each value.

    Attributes:
        scene_id: Unique for each analysed scene.
        label: Words for people; may be empty.
        values: Every parameter of the space once, in its order.
        urgent: True may stop a running tree at once if new scenes preempt.
        person_id: The person, by name or by the id of a tracker; empty if unknown.
        place: Place of the interaction; may be empty.
        persons: Number of tracked persons; 0 if they are not counted.
        visits: Number of visits of the person, including this one; 0 if not known by name.
        remembered: What agents remember about the person.
        stamp: Time of the analysis [s].
        stale_s: For a live scene: how long the scene layer has been silent, once that is too long
            for the values to be current; 0 otherwise [s].
    """

    scene_id: str
    label: str
    person: bool
    values: tuple[SceneValue, ...]
    urgent: bool = False
    person_id: str = ""
    place: str = ""
    persons: int = 0
    visits: int = 0
    remembered: Mapping[str, Fact] = field(default_factory=dict)
    stamp: float = 0.0
    stale_s: float = 0.0

    @cached_property
    def vector(self) -> Vector:
        """The values alone, in the order of the space, NaN for missing ones."""
        return tuple(value.value for value in self.values)

    @cached_property
    def observed(self) -> Vector:
        """The measured, given or told values, in the order of the space, NaN for others."""
        return tuple(value.value if value.observed else MISSING for value in self.values)

    @cached_property
    def std(self) -> Vector:
        """The standard deviations alone, in the order of the space, NaN for missing ones."""
        return tuple(value.std for value in self.values)

    def get(self, name: str) -> float:
        """Return the value of a parameter, NaN when missing; ``KeyError`` if there is none."""
        for value in self.values:
            if value.name == name:
                return value.value
        raise KeyError(name)

    def of_person(self, member: str) -> Fact:
        """Return ``name``, ``visits`` or a remembered fact of a person who is known by name.

        Raises:
            KeyError: No person is known by name, or no such fact is remembered.
        """
        if not self.visits or not self.person_id:
            raise KeyError(member)
        match member:
            case "name":
                return self.person_id
            case "visits":
                return self.visits
        return self.remembered[member]

    def with_id(self, scene_id: str) -> Scene:
        """Return the same scene under another id."""
        return replace(self, scene_id=scene_id)


@dataclass(frozen=True, kw_only=True)
class SceneSpace:
    """The ordered scene parameters that all parts of one system share.

    Attributes:
        parameters: At least one, with unique names; those that profiles do not have come last.
        mood: Name of the parameter for the person's mood; None if there is none.
        remembers: What agents may remember about a person, with its type.
        left_out: For a space of profiles: names of the scene parameters that profiles do not have.
    """

    parameters: tuple[SceneParameter, ...]
    mood: str | None = None
    remembers: Mapping[str, FieldType] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Put the parameters that profiles do not have after the others, in order."""
        ordered = sorted(self.parameters, key=lambda one: not one.profiled)
        object.__setattr__(self, "parameters", tuple(ordered))

    @cached_property
    def profiles(self) -> SceneSpace:
        """The space of profiles: the parameters that profiles have, which come first."""
        shared = tuple(one for one in self.parameters if one.profiled)
        if len(shared) == len(self.parameters):
            return self
        names = [one.name for one in shared]
        return replace(
            self,
            parameters=shared,
            mood=self.mood if self.mood in names else None,
            left_out=tuple(name for name in self.names if name not in names),
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameter names in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def widths(self) -> tuple[float, ...]:
        """Maximum minus minimum of each parameter, in order."""
        return tuple(parameter.maximum - parameter.minimum for parameter in self.parameters)

    @cached_property
    def weights(self) -> tuple[float, ...]:
        """Weight of each parameter in ``scene.yaml``, in order."""
        return tuple(parameter.weight for parameter in self.parameters)

    def __len__(self) -> int:
        return len(self.parameters)

    def vector(self, values: Iterable[float], *, missing: bool = False, what: str = "") -> Vector:
        """Return values from outside, one per parameter in order, as a vector.

        With ``missing``, NaN marks a missing value; ``what`` is the subject of error messages.

        Raises:
            Refused: ``WRONG_LENGTH``, ``NOT_A_NUMBER``, ``NOT_FINITE`` or ``OUT_OF_RANGE``.
        """
        try:
            vector = tuple(float(value) for value in values)
        except (TypeError, ValueError, OverflowError) as error:
            raise Refused(
                RefusalCode.NOT_A_NUMBER, f"{_subject(what)}a value is not a number ({error})"
            ) from None
        if len(vector) != len(self.parameters):
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{_subject(what)}{len(vector)} values, expected {len(self.parameters)}: "
                f"{', '.join(self.names)}",
            )
        for parameter, value in zip(self.parameters, vector, strict=True):
            if missing and math.isnan(value):
                continue
            check_value(parameter, value, what=what)
        return vector

    def from_mapping(self, values: Mapping[str, float], *, what: str = "") -> Vector:
        """Check named values and return them in order.

        Raises:
            Refused: ``UNKNOWN_PARAMETER`` or ``WRONG_LENGTH``, else as in :meth:`vector`.
        """
        for name in values:
            self.parameter(name, what=what)
        absent = [name for name in self.names if name not in values]
        if absent:
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{_subject(what)}no value for {', '.join(absent)}; all are needed",
            )
        return self.vector((values[name] for name in self.names), what=what)

    def ordered(self, values: Mapping[str, float]) -> Vector:
        """Return named values in the order of the space, unchecked; NaN for those not named."""
        return tuple(values.get(name, MISSING) for name in self.names)

    def completed(self, scene: Scene, *, met: bool) -> Scene:
        """Return a scene whose unknown values are filled in, with or without a person ``met``."""
        values = (
            parameter.unknown(met=met)
            if value.origin in (Origin.MISSING, Origin.DEFAULT)
            else value
            for parameter, value in zip(self.parameters, scene.values, strict=True)
        )
        return replace(scene, values=tuple(values))

    def compared(self, scene: Scene) -> Scene:
        """Return a scene of the whole space reduced to this space of profiles."""
        if len(scene.values) == len(self.parameters):
            return scene
        return replace(scene, values=scene.values[: len(self.parameters)])

    def named(self, vector: Iterable[float]) -> dict[str, float]:
        """Return the values of a vector by name, in order, without missing ones."""
        pairs = zip(self.names, vector, strict=True)
        return {name: value for name, value in pairs if not math.isnan(value)}

    def parameter(self, name: str, *, what: str = "") -> SceneParameter:
        """Return the parameter with a name, or refuse it with ``UNKNOWN_PARAMETER``."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        if name in self.left_out:
            raise Refused(
                RefusalCode.UNKNOWN_PARAMETER,
                f"{_subject(what)}no profile has '{name}', as scene.yaml says of it "
                f"'profile: false'; profiles have {', '.join(self.names)}",
            )
        raise Refused(
            RefusalCode.UNKNOWN_PARAMETER,
            f"{_subject(what)}no scene parameter '{name}'; there are {', '.join(self.names)}",
        )

    def clamp(self, vector: Sequence[float]) -> Vector:
        """Return the vector moved into the ranges; NaN stays NaN."""
        return tuple(p.clamp(v) for p, v in zip(self.parameters, vector, strict=True))

    def scene(self, values: Iterable[SceneValue]) -> tuple[SceneValue, ...]:
        """Check the values of a scene from outside and return them in the order of the space.

        Raises:
            Refused: ``EMPTY``, ``UNKNOWN_PARAMETER``, ``DUPLICATE_PARAMETER``, ``WRONG_LENGTH``,
                ``ORIGIN_MISMATCH``, ``NOT_FINITE`` or ``OUT_OF_RANGE``.
        """
        found: dict[str, SceneValue] = {}
        for value in values:
            parameter = self.parameter(value.name, what="scene")
            if value.name in found:
                raise Refused(
                    RefusalCode.DUPLICATE_PARAMETER, f"scene: '{value.name}' stands twice"
                )
            if value.origin is Origin.MISSING:
                if not math.isnan(value.value):
                    raise Refused(
                        RefusalCode.ORIGIN_MISMATCH,
                        f"scene: '{value.name}' is marked missing but has the value "
                        f"{value.value:g}; a missing value is NaN",
                    )
                value = replace(SceneValue.missing(value.name), source=value.source)
            else:
                check_value(parameter, value.value, what="scene")
                _check_certainty(value)
            found[value.name] = value
        if not found:
            raise Refused(RefusalCode.EMPTY, f"scene: no values; expected {', '.join(self.names)}")
        absent = [name for name in self.names if name not in found]
        if absent:
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"scene: no entry for {', '.join(absent)}; mark unknown values as missing",
            )
        return tuple(found[name] for name in self.names)


def mood_of(scene: Scene, space: SceneSpace, *, confidence: float = 0.0) -> float:
    """Return the mood of the person in a scene, NaN if unknown.

    It is known if a person is there and the value was measured, given or told with ``confidence``
    or more: a lost person is not unhappy, nor is one whose mood is only assumed.
    """
    if space.mood is None or not scene.person:
        return MISSING
    value = scene.values[space.names.index(space.mood)]
    return value.value if value.observed and value.confidence >= confidence else MISSING


def follow_up_id(origin: str, number: int) -> str:
    """Return the scene id of an interaction's follow-up round, counted from 1."""
    return f"{origin}+{number}"


def origin_id(scene_id: str) -> str:
    """Return the id of the scene that the market started with, also for a follow-up round."""
    return _FOLLOW_UP.sub("", scene_id)


def awarded_id(scene_id: str, number: int) -> str:
    """Return the id under which a scene runs again after an operator's award."""
    return f"{unawarded_id(scene_id)}+award{number}"


def unawarded_id(scene_id: str) -> str:
    """Return the id of the scene of an operator's award."""
    return _AWARDED.sub("", scene_id)


def first_id(scene_id: str) -> str:
    """Return the id under which a scene was first announced, also after a market restart."""
    return origin_id(scene_id).removesuffix(AGAIN)


def scene_name(scene: Any) -> str:
    """Return the name of a scene or its message for people: its label, else its values.

    Example:
        ``age 4.5, familiarity 1, mood 3``
    """
    known = [value for value in scene.values if not math.isnan(value.value)]
    who = [] if scene.person else ["nobody"]
    text = ", ".join([*who, *(f"{one.name} {format_known(one.value)}" for one in known)])
    return str(scene.label) or text or "nothing known"


def finite_or_none(value: float) -> float | None:
    """Return a number as JSON can hold it; None for NaN and infinity."""
    return value if math.isfinite(value) else None


def check_value(parameter: SceneParameter, value: float, *, what: str = "") -> float:
    """Return ``value`` if it is in range; else refuse it: ``NOT_FINITE``, ``OUT_OF_RANGE``."""
    if not math.isfinite(value):
        raise Refused(
            RefusalCode.NOT_FINITE,
            f"{_subject(what)}{parameter.name} is {value}, expected a number between "
            f"{parameter.minimum:g} and {parameter.maximum:g}",
        )
    if not parameter.minimum <= value <= parameter.maximum:
        raise Refused(
            RefusalCode.OUT_OF_RANGE,
            f"{_subject(what)}{parameter.name} is {value:g}, expected "
            f"{parameter.minimum:g} to {parameter.maximum:g}",
        )
    return value


def _check_certainty(value: SceneValue) -> None:
    if not 0.0 <= value.std < math.inf:
        raise Refused(
            RefusalCode.OUT_OF_RANGE,
            f"scene: the standard deviation of {value.name} is {value.std:g}, expected 0 or more",
        )
    if not 0.0 <= value.confidence <= 1.0:
        raise Refused(
            RefusalCode.OUT_OF_RANGE,
            f"scene: the confidence in {value.name} is {value.confidence:g}, expected 0 to 1",
        )


def _subject(what: str) -> str:
    return f"{what}: " if what else ""
