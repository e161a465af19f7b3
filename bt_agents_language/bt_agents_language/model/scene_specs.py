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
"""What an expression of a source calls the message, or the item of a person in it."""

PERSON = "person"
"""What the source of the presence of a person is called, and who a topic is about."""

LOST_AFTER_S = 1.0
"""Who has not been in the list for so long is gone, where nothing else is written [s]."""

HOLD_S = 1.0
"""For so long must another be better, where nothing else is written [s]."""

LARGEST_STD = 1e100
"""A larger standard deviation of a reading is none."""

_LARGEST_WORD = 1e18
_PLACEHOLDER = re.compile(r"<([a-z][a-z0-9_]*)>")
_STARTS_WITH_DIGIT = re.compile(r"(^|/)[0-9]")
_TOPIC_WORD = re.compile(r"[A-Za-z0-9_]{1,100}")


class MissingRule(Enum):
    """What a scene holds for a parameter that no source measures; the value is the word in a file.

    Attributes:
        LEAVE_OUT: Nothing; the parameter does not count.
        ESTIMATE: What is known from before of this person, else of this place, else nothing.
        DEFAULT: The same, and the declared default where nothing is known.
    """

    LEAVE_OUT = "leave_out"
    ESTIMATE = "estimate"
    DEFAULT = "default"


class AddresseeRule(Enum):
    """Whom of several persons a scene is about; the value is the word in a file."""

    ENGAGED = "engaged"
    NEAREST = "nearest"
    FIRST = "first"


def word_of(number: float) -> str | None:
    """Return a number as it stands in a table: ``1`` for 1 and 1.0; None for what stands in none.

    Those from 10¹⁸ on do not: floats do not tell all of them apart.
    """
    if not -_LARGEST_WORD < number < _LARGEST_WORD:
        return None
    return str(int(number)) if number == int(number) else f"{number:g}"


def path_of(expression: Expression) -> str | None:
    """Return the path of a field of the message that an expression is; None when it is more."""
    path = expression.text.removeprefix(f"{MESSAGE}.")
    return path if expression.names == {f"{MESSAGE}.{path}"} else None


@dataclass(frozen=True, kw_only=True)
class SourceSpec:
    """Where readings come from: of a scene parameter, or of something about persons and places.

    Attributes:
        parameter: Name of the scene parameter; else ``person`` for the presence of somebody,
            ``place``, ``known``, ``addressee`` or the name of a part of a person.
        topic: ROS name, relative unless it starts with a slash; ``<person>`` and names of parts in
            such brackets stand for ids.
        type: ROS type, for example ``std_msgs/msg/Float64``.
        field: The reading, over ``msg.*``.
        points: Linear map from reading to parameter as (reading, value) pairs, readings rising;
            empty takes the reading as it is.
        table: Words and their values, instead of ``points``; empty for none.
        stale_after_s: A reading older than this is missing; infinite for none [s].
        latched: True when the last message is kept for those who come later.
        confidence: From 0, not measured, to 1; true is 1 and false 0; None where none is stated.
        std: Standard deviation, in the unit of the reading, with a table in that of the parameter;
            None where none is stated.
        smoothing_s: Time constant of exponential smoothing; 0 for none [s].
        of_item: True when a message is the list of tracked persons and ``msg`` one of its items.
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
        """Whether its readings are each about one person."""
        return self.of_item or bool(self.placeholders)

    @cached_property
    def path(self) -> str | None:
        """The path of the field that is the reading; None where the reading is computed."""
        return path_of(self.field)

    def topic_of(self, ids: Mapping[str, str]) -> str | None:
        """Return the topic with ids in place of the names in brackets, ``person`` and parts.

        It is None when an id is not known or cannot stand in the name of a topic.
        """
        found = [ids.get(name, "") for name in self.placeholders]
        if not all(map(_TOPIC_WORD.fullmatch, found)):
            return None
        topic = _PLACEHOLDER.sub(lambda match: ids[match[1]], self.topic)
        return None if _STARTS_WITH_DIGIT.search(topic) or "__" in topic else topic


@dataclass(frozen=True, kw_only=True)
class TrackedSpec:
    """Where it is said who is tracked; as :class:`SourceSpec`.

    Attributes:
        field: Path of the list in the message.
        id: Path of a person's id in an item of the list; empty when the items are the ids.
        stale_after_s: Nobody is tracked after so much silence; infinite for no limit [s].
        lost_after_s: Who has not been in the list for so long is gone [s].
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
    """Whom of several persons a scene is about.

    Attributes:
        rule: The most engaged, the nearest, or the one who came first.
        source: How engaged a person is, more is better, or how far away, less is better; None for
            who came first.
        better_by: So much better than the addressee must another be, in the unit of the source.
        hold_s: For so long must the other be better [s].
    """

    rule: AddresseeRule
    source: SourceSpec | None = None
    better_by: float = 0.0
    hold_s: float = HOLD_S


@dataclass(frozen=True, kw_only=True)
class PersonsSpec:
    """Who is tracked, who of them is known by name, and whom a scene is about.

    Attributes:
        parts: Parts of a person with ids and topics of their own, such as the face: sources of
            the id of each.
        known: Says of a person by 0.5 or more that the id is a name, not a tracker's number; None
            when ids are never names.
    """

    tracked: TrackedSpec
    parts: tuple[SourceSpec, ...] = ()
    known: SourceSpec | None = None
    addressee: AddresseeSpec = AddresseeSpec(rule=AddresseeRule.FIRST)

    @cached_property
    def sources(self) -> tuple[SourceSpec, ...]:
        """The sources of what is not a scene parameter."""
        others = (self.known, self.addressee.source)
        return (*self.parts, *(source for source in others if source is not None))


@dataclass(frozen=True, kw_only=True)
class SceneSpec:
    """``scene.yaml``: the parameters of every scene and the sources that feed them.

    Attributes:
        sources: Those of parameters; several of one parameter are fused.
        person: Says whether somebody is there; None where ``persons`` says so, or nothing does.
        persons: Who is there; None where persons are not distinguished.
        place: Where the robot is, or the source that says so.
        missing: What a scene holds for parameters that nobody measures; what is not named is left
            out.
        language: Language of the agents' texts where nothing else says one; may be empty.
        personal: Parameters whose given and told values belong to the person, not the interaction.
        shares_persons: Whether layers of persons may leave the robot, and come from others.
        warnings: What its reader found legal, but rarely meant.
    """

    space: SceneSpace
    sources: tuple[SourceSpec, ...]
    person: SourceSpec | None
    persons: PersonsSpec | None = None
    place: str | SourceSpec = ""
    missing: Mapping[str, MissingRule] = field(default_factory=dict)
    language: str = ""
    personal: frozenset[str] = frozenset()
    shares_persons: bool = False
    warnings: tuple[Diagnostic, ...] = ()

    @cached_property
    def every_source(self) -> tuple[SourceSpec, ...]:
        """All sources, also of what is not a scene parameter."""
        single = (self.person, self.place if isinstance(self.place, SourceSpec) else None)
        persons = self.persons.sources if self.persons is not None else ()
        return (*self.sources, *(one for one in single if one is not None), *persons)

    @property
    def names_persons(self) -> bool:
        """True where sources say who is known by name."""
        return self.persons is not None and self.persons.known is not None

    def missing_rule(self, parameter: str) -> MissingRule:
        """Return what a scene holds for a parameter that nobody measures."""
        return self.missing.get(parameter, MissingRule.LEAVE_OUT)
