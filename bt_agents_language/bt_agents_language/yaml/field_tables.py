# SPDX-License-Identifier: Apache-2.0
"""Field tables: the keys of each kind of file, for its reader, its JSON Schema and its page."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Self, TypeAlias

from bt_agents_core.field_types import Plain
from bt_agents_core.scene import SceneParameter


class Form(Enum):
    """Forms of a value other than lists and mappings of keys; pages show the word."""

    ANY = "any value"
    AMOUNT = "number, time, length or angle"
    ANGLE = "angle"
    BOOLEAN = "true or false"
    CONDITION = "condition"
    DURATION = "time"
    INTEGER = "whole number"
    LENGTH = "length"
    NAME = "new name"
    NODE = "node"
    NOTHING = "nothing"
    NUMBER = "number"
    ROS_NAME = "ROS name"
    ROS_TYPE = "ROS type"
    TEXT = "text"


@dataclass(frozen=True)
class Single:
    """Single value of a form.

    Attributes:
        placeholders: Whether a ROS name may contain ``<person>``.
        scene_names: Whether a condition may use the scene, the live scene and the mood, which its
            description then lists.
    """

    form: Form
    minimum: float | None = None
    maximum: float | None = None
    _: KW_ONLY
    placeholders: bool = False
    scene_names: bool = False


@dataclass(frozen=True)
class WordChoice:
    """One of some words."""

    words: tuple[str, ...]


@dataclass(frozen=True)
class Items:
    """A list.

    Attributes:
        filled: Whether one item at least must be there.
        empty: Message about a list without items where that is an error; else empty.
        add: Hint with that message.
        unique: Whether items must differ.
    """

    item: Value
    _: KW_ONLY
    filled: bool = False
    empty: str = ""
    add: str = "add one"
    unique: bool = False


@dataclass(frozen=True)
class Several:
    """One value, or a list of such values.

    Attributes:
        other: Alternative value.
    """

    one: Value
    other: Value | None = None


class Key(Enum):
    """Keys of a mapping whose keys the author chooses."""

    ANY = "any"
    NEW_NAME = "new name"
    NUMBER = "number"
    TOPIC = "topic"


@dataclass(frozen=True)
class Entries:
    """A mapping whose keys the author chooses.

    Attributes:
        of: The entries, for messages: ``names and tunables``.
        filled: Whether one entry at least must be there.
        empty: Message about a mapping without entries where that is an error; else empty.
        add: Hint with that message.
        single: Whether there is exactly one entry.
    """

    value: Value
    of: str = ""
    _: KW_ONLY
    keys: Key = Key.NEW_NAME
    filled: bool = False
    empty: str = ""
    add: str = "add one"
    single: bool = False


@dataclass(frozen=True)
class SceneValues:
    """Values of scene parameters by name.

    Attributes:
        every: Whether all parameters are required.
        of_profiles: Whether only parameters that profiles have are allowed.
        filled: Whether one at least must be there.
        person: Description of the additional key ``person``, if that is allowed.
        limits: Smallest and largest value for a parameter; None for its own range.
    """

    _: KW_ONLY
    every: bool = False
    of_profiles: bool = False
    filled: bool = False
    person: str = ""
    limits: Callable[[SceneParameter], tuple[float, float]] | None = None


@dataclass(frozen=True)
class SceneNameList:
    """List of names of scene parameters that profiles have, or a word for all of them."""

    every: str


@dataclass(frozen=True)
class Either:
    """Value of one of several types."""

    options: tuple[Value, ...]


@dataclass(frozen=True)
class Shared:
    """Mapping whose keys are in the file's table of shared ones."""

    name: str


@dataclass(frozen=True)
class FieldDecl:
    """Key of a mapping.

    Attributes:
        name: The word in files.
        value: Its allowed values.
        description: One sentence for authors.
        required: Whether it must be written.
        default: Value if it is not written, for pages and editors.
    """

    name: str
    value: Value
    description: str = ""
    _: KW_ONLY
    required: bool = False
    default: Plain = None


@dataclass(frozen=True)
class Needs:
    """Keys that are required together, in addition to those that are always required.

    Attributes:
        keys: Keys that are all required.
        hint: Text about it for editors.
        options: Keys; at least one of them is required.
        exclusive: Whether at most one of the options is allowed.
    """

    keys: tuple[str, ...] = ()
    _: KW_ONLY
    hint: str = ""
    options: tuple[Needs, ...] = ()
    exclusive: bool = False


def one_of(keys: Collection[str], hint: str, *, exclusive: bool = False) -> Needs:
    """Return the requirement of one of some keys."""
    return Needs(options=tuple(Needs((key,), hint=hint) for key in keys), exclusive=exclusive)


@dataclass(frozen=True, kw_only=True)
class KeyTable:
    """Allowed keys of a mapping.

    Attributes:
        what: The mapping, for messages: ``a rule``; empty if callers name it.
        fields: In the order of messages, pages and schemas.
        needs: Requirements in addition to the required keys.
        filled: Whether one key at least must be there.
        scene: Whether the names of scene parameters are keys, too, before the others.
    """

    what: str = ""
    fields: tuple[FieldDecl, ...]
    needs: Needs | None = None
    filled: bool = False
    scene: bool = False

    @cached_property
    def values(self) -> Mapping[str, Value]:
        """Allowed values of each key."""
        return {one.name: one.value for one in self.fields}

    @cached_property
    def required(self) -> tuple[str, ...]:
        """Required keys."""
        return tuple(one.name for one in self.fields if one.required)

    def only(self, keys: Collection[str]) -> Self:
        """Return the table with some of its keys."""
        return replace(self, fields=tuple(one for one in self.fields if one.name in keys))

    def extended(self, *fields: FieldDecl, what: str = "") -> Self:
        """Return the table with further fields, which replace fields with the same names."""
        every = {one.name: one for one in (*self.fields, *fields)}
        return replace(self, what=what or self.what, fields=tuple(every.values()))


@dataclass(frozen=True, kw_only=True)
class FileKind(KeyTable):
    """Kind of file.

    Attributes:
        name: The word for it: ``market``.
        title: The word for it as a heading.
        description: One sentence for authors.
        shared: Name → keys of a mapping that :class:`Shared` values have.
    """

    name: str
    title: str
    description: str
    shared: Mapping[str, KeyTable] = field(default_factory=dict)


Value: TypeAlias = (
    Single | WordChoice | Items | Several | Entries | SceneValues | SceneNameList | Either | Shared
    | KeyTable
)  # fmt: skip
"""Allowed values of a key."""

ANY = Single(Form.ANY)
AMOUNT = Single(Form.AMOUNT)
ANGLE = Single(Form.ANGLE)
BOOLEAN = Single(Form.BOOLEAN)
CONDITION = Single(Form.CONDITION)
DURATION = Single(Form.DURATION)
FIELDS = Entries(ANY, keys=Key.ANY)
LENGTH = Single(Form.LENGTH)
NAME = Single(Form.NAME)
NODE = Single(Form.NODE)
NUMBER = Single(Form.NUMBER)
ROS_NAME = Single(Form.ROS_NAME)
ROS_TYPE = Single(Form.ROS_TYPE)
TEXT = Single(Form.TEXT)
SHARE = Single(Form.NUMBER, 0, 1)


def integer(minimum: int | None = None, maximum: int | None = None) -> Single:
    """Return the declaration of an integer in a range."""
    return Single(Form.INTEGER, minimum, maximum)


def number(minimum: float | None = None, maximum: float | None = None) -> Single:
    """Return the declaration of a number in a range."""
    return Single(Form.NUMBER, minimum, maximum)
