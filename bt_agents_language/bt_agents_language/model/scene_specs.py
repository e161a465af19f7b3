# SPDX-License-Identifier: Apache-2.0
"""Specification of a scene: its parameters, their sources, the place and the persons."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

from bt_agents_core.diagnostic import Diagnostic, Position
from bt_agents_core.scene import SceneSpace
from bt_agents_language.expression.expressions import Expression

MESSAGE = "msg"
"""Name of the message, or of a person's item in it, in expressions of a source."""

PERSON = "person"
"""Name of the source for the presence of a person, and placeholder in topics."""

LOST_AFTER_S = 1.0
"""Default time after which a person missing in the list is gone [s]."""

HOLD_S = 1.0
"""Default time that another person must stay better [s]."""

LARGEST_STD = 1e100
"""Largest standard deviation of a reading; larger ones count as missing."""

_LARGEST_WORD = 1e18
_PLACEHOLDER = re.compile(r"<([a-z][a-z0-9_]*)>")
_STARTS_WITH_DIGIT = re.compile(r"(^|/)[0-9]")
_TOPIC_WORD = re.compile(r"[A-Za-z0-9_]{1,100}")


class MissingRule(Enum):
    """Rule for a parameter that no source measures; the value is the word in files.

    Attributes:
        LEAVE_OUT: No value; the parameter does not count.
        ESTIMATE: Earlier value of this person, else of this place, else no value.
        DEFAULT: The same, but with the declared default if nothing is known.
    """

    LEAVE_OUT = "leave_out"
    ESTIMATE = "estimate"
    DEFAULT = "default"


class AddresseeRule(Enum):
    """Rule for the person that a scene is about; the value is the word in files."""

    ENGAGED = "engaged"
    NEAREST = "nearest"
    FIRST = "first"


def word_of(number: float) -> str | None:
    """Return a number as written in a table: ``1`` for 1 and 1.0; None if no table can hold it.

    Tables cannot hold numbers from 10¹⁸ on, because floats do not distinguish all of them.
    """
    if not -_LARGEST_WORD < number < _LARGEST_WORD:
        return None
    return str(int(number)) if number == int(number) else f"{number:g}"


def path_of(expression: Expression) -> str | None:
    """Return the message field path that an expression consists of; None if it is more."""
    path = expression.text.removeprefix(f"{MESSAGE}.")
    return path if expression.names == {f"{MESSAGE}.{path}"} else None


@dataclass(frozen=True, kw_only=True)
class SourceSpec:
    """Source of readings for a scene parameter, or for data about persons and places.

    Attributes:
        parameter: Name of the scene parameter; else ``person`` for the presence of a person,
            ``place``, ``known``, ``addressee`` or the name of a part of a person.
        topic: ROS name, relative unless it starts with a slash; ``<person>`` and names of parts in
            angle brackets are placeholders for ids.
        type: ROS type, for example ``std_msgs/msg/Float64``.
        field: The reading, over ``msg.*``.
        points: Linear map from reading to parameter as (reading, value) pairs, readings rising;
            empty takes the reading unchanged.
        table: Words and their values, instead of ``points``; empty for none.
        stale_after_s: A reading older than this is missing; infinite for none [s].
        latched: True if the last message is kept for late subscribers.
        confidence: From 0, not measured, to 1; true is 1 and false 0; None if not stated.
        std: Standard deviation in the unit of the reading, or with a table, of the parameter; None
            if not stated.
        smoothing_s: Time constant of exponential smoothing; 0 for none [s].
        of_item: True if a message is the list of tracked persons and ``msg`` one of its items.
    """

    parameter: str
    topic: str
    type: str
    field: Expression
    points: tuple[tuple[float, float], ...] = ()
    table: tuple[tuple[str, float], ...] = ()
    stale_after_s: float
    latched: bool = False
    confidence: Expression | None = None
    std: Expression | None = None
    smoothing_s: float = 0.0
    of_item: bool = False
    position: Position

    @cached_property
    def placeholders(self) -> tuple[str, ...]:
        """The names in angle brackets in the topic: ``person``, or parts of a person."""
        return tuple(_PLACEHOLDER.findall(self.topic))

    @property
    def per_person(self) -> bool:
        """Whether each of its readings is about one person."""
        return self.of_item or bool(self.placeholders)

    @cached_property
    def path(self) -> str | None:
        """Path of the field with the reading; None if the reading is computed."""
        return path_of(self.field)

    def topic_of(self, ids: Mapping[str, str]) -> str | None:
        """Return the topic with ids in place of the names in brackets, ``person`` and parts.

        It is None if an id is unknown or invalid in the name of a topic.
        """
        found = [ids.get(name, "") for name in self.placeholders]
        if not all(map(_TOPIC_WORD.fullmatch, found)):
            return None
        topic = _PLACEHOLDER.sub(lambda match: ids[match[1]], self.topic)
        return None if _STARTS_WITH_DIGIT.search(topic) or "__" in topic else topic


@dataclass(frozen=True, kw_only=True)
class TrackedSpec:
    """Source of the list of tracked persons, like :class:`SourceSpec`.

    Attributes:
        field: Path of the list in the message.
        id: Path of a person's id in an item of the list; empty if the items are the ids.
        stale_after_s: Silence after which nobody is tracked; infinite for no limit [s].
        lost_after_s: Time after which a person missing in the list is gone [s].
    """

    topic: str
    type: str
    field: str
    id: str = ""
    stale_after_s: float
    latched: bool = False
    lost_after_s: float = LOST_AFTER_S
    position: Position


@dataclass(frozen=True, kw_only=True)
class AddresseeSpec:
    """Choice of the person that a scene is about.

    Attributes:
        rule: The most engaged, the nearest, or the one who came first.
        source: Engagement of a person, where more is better, or distance, where less is better;
            None for the one who came first.
        better_by: By how much another must be better than the addressee, in the source's unit.
        hold_s: Time that the other must stay better [s].
    """

    rule: AddresseeRule
    source: SourceSpec | None = None
    better_by: float = 0.0
    hold_s: float = HOLD_S


@dataclass(frozen=True, kw_only=True)
class PersonsSpec:
    """Tracked persons, those known by name, and the person that a scene is about.

    Attributes:
        parts: Parts of a person with ids and topics of their own, such as the face: sources of
            the id of each.
        known: Source that states with 0.5 or more that a person's id is a name instead of a
            tracker's number; None if ids are never names.
    """

    tracked: TrackedSpec
    parts: tuple[SourceSpec, ...] = ()
    known: SourceSpec | None = None
    addressee: AddresseeSpec = AddresseeSpec(rule=AddresseeRule.FIRST)

    @cached_property
    def sources(self) -> tuple[SourceSpec, ...]:
        """Sources for data other than scene parameters."""
        others = (self.known, self.addressee.source)
        return (*self.parts, *(source for source in others if source is not None))


@dataclass(frozen=True, kw_only=True)
class SceneSpec:
    """``scene.yaml``: the parameters of every scene and the sources that feed them.

    Attributes:
        sources: Sources of parameters; several sources of one parameter are fused.
        person: Source for the presence of a person; None if ``persons`` covers it, or nothing.
        persons: Tracked persons; None if persons are not distinguished.
        place: Place of the robot, or its source.
        missing: Rules for parameters that are not measured; others are left out.
        language: Default language of the agents' texts; may be empty.
        personal: Parameters whose given and told values belong to the person, not the interaction.
        warnings: Warnings of its reader about legal but rarely intended content.
    """

    space: SceneSpace
    sources: tuple[SourceSpec, ...]
    person: SourceSpec | None
    persons: PersonsSpec | None = None
    place: str | SourceSpec = ""
    missing: Mapping[str, MissingRule] = field(default_factory=dict)
    language: str = ""
    personal: frozenset[str] = frozenset()
    warnings: tuple[Diagnostic, ...] = ()

    @cached_property
    def every_source(self) -> tuple[SourceSpec, ...]:
        """All sources, also for data other than scene parameters."""
        single = (self.person, self.place if isinstance(self.place, SourceSpec) else None)
        persons = self.persons.sources if self.persons is not None else ()
        return (*self.sources, *(one for one in single if one is not None), *persons)

    @property
    def names_persons(self) -> bool:
        """True if sources identify persons by name."""
        return self.persons is not None and self.persons.known is not None

    def missing_rule(self, parameter: str) -> MissingRule:
        """Return the rule for a parameter that is not measured."""
        return self.missing.get(parameter, MissingRule.LEAVE_OUT)
