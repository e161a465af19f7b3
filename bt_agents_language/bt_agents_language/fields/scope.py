# SPDX-License-Identifier: Apache-2.0
"""Scopes of names: the names that a place in a file may use, their types, and their use."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from typing import NoReturn

from bt_agents_core.field_types import FieldType
from bt_agents_core.local_time import WEEKDAYS
from bt_agents_core.scene import Labels, SceneSpace
from bt_agents_core.stop_cause import STOPPERS
from bt_agents_core.text import join_quoted
from bt_agents_language.diagnostics.collection import did_you_mean, nearest
from bt_agents_language.expression.expression_hints import ABSENT, ABSENT_HINT
from bt_agents_language.expression.expression_tokens import NAME, OPERATOR_WORDS
from bt_agents_language.expression.expression_values import ANY_LABELS, ValueKind
from bt_agents_language.expression.expressions import Expression, parse_expression
from bt_agents_language.expression.functions import FUNCTIONS
from bt_agents_language.expression.operators import HOUR
from bt_agents_language.expression.ranges import Range
from bt_agents_language.expression.units import DIMENSIONS
from bt_agents_language.fields.interfaces import MessageFields
from bt_agents_language.fields.texts import TEXT_PREFIX, NoText, Texts, WrittenText

GROUPS = ("scene", "live", "mood", "profile", "clock", "cancel")
"""Groups of names with a point, which no other name may have."""

RESERVED = (
    *GROUPS, "msg", "result",
    "true", "false", "null", *OPERATOR_WORDS, *FUNCTIONS,
)  # fmt: skip
"""Words that are not allowed as names of tunables, inputs and outputs."""

_WORD = re.compile(NAME)

KINDS = {
    FieldType.TEXT: ValueKind.TEXT,
    FieldType.NUMBER: ValueKind.NUMBER,
    FieldType.INTEGER: ValueKind.NUMBER,
    FieldType.BOOLEAN: ValueKind.BOOLEAN,
    **dict.fromkeys(DIMENSIONS, ValueKind.NUMBER),
}
"""Type of a name → kind of its value; names of any type have no entry."""


@dataclass(frozen=True, kw_only=True)
class Assigned:
    """Name that nodes assign a value to while a tree runs.

    Attributes:
        type: Type of the value, if all nodes agree.
        node: Key of the first node that assigns it.
        line: Line of that node.
        declared: Whether it is an output of this subtree, whose type every value must have.
        choices: Its possible texts; empty for any.
    """

    type: FieldType
    node: str
    line: int
    declared: bool = False
    choices: tuple[str, ...] = ()


def _no_text_inside(name: str) -> NoReturn:
    """Refuse a name in a text, so that no text can contain itself."""
    raise NoText(
        f"a text cannot insert another one, '{TEXT_PREFIX}{name[:80]}'",
        "insert both where they are needed",
    )


class NameScope:
    """Names with their types; it records which names were used, and which may have a value.

    Args:
        types: Type of each name that always has a value, or never gets one.
        written: Names that nodes assign values to.
        messages: Name of a message (``msg``, ``result``) → its fields.
        hidden: Names that exist elsewhere in the file → how to access them from here.
        lenient: True accepts unknown names, because an unreadable declaration may hold them.
        ranges: Declared ranges of names in ``types``.
        labels: Words for the values of scene parameters, by their names.
        texts: Finds the texts of names that start with ``t.``.

    Attributes:
        used: Names that were used.
        given: Names in ``written`` that an earlier node may have assigned a value to.
    """

    def __init__(
        self,
        types: Mapping[str, FieldType],
        written: Mapping[str, Assigned] | None = None,
        messages: Mapping[str, MessageFields] | None = None,
        hidden: Mapping[str, str] | None = None,
        lenient: bool = False,
        ranges: Mapping[str, Range] | None = None,
        labels: Mapping[str, Labels] | None = None,
        texts: Texts | None = None,
    ) -> None:
        self.used: set[str] = set()
        self.given: set[str] = set()
        self._types = dict(types)
        self._written = dict(written or {})
        self._messages = dict(messages or {})
        self._hidden = dict(hidden or {})
        self._lenient = lenient
        self._ranges = {HOUR: Range(0, 23), **(ranges or {})}
        self._labels = dict(labels or {})
        self._find_text = texts.find if texts is not None else None

    def and_message(self, name: str, fields: MessageFields) -> NameScope:
        """Return these names and the fields of a message; both share their records."""
        names = copy(self)
        names._messages = {**self._messages, name: fields}
        return names

    def and_names(self, types: Mapping[str, FieldType]) -> NameScope:
        """Return these names and more that always have a value; both share their records."""
        names = copy(self)
        names._types = {**self._types, **types}
        return names

    def without_texts(self) -> NameScope:
        """Return these names without texts, for use in a text; both share their records."""
        names = copy(self)
        names._find_text = _no_text_inside
        return names

    def text(self, name: str) -> WrittenText:
        """Return the text of a name that starts with ``t.``.

        Raises:
            NoText: There is no such text.
        """
        if self._find_text is None:
            raise NoText(f"there is no text '{name[:80]}': this file is in no trees folder")
        return self._find_text(name.removeprefix(TEXT_PREFIX))

    def _plain_text(self, name: str) -> str:
        """Return the text of a name in an expression, if it is one text without names."""
        scalars = self.text(name).scalars
        if len(scalars) > 1:
            raise NoText(f"'{name}' is one of several texts, an expression needs a certain one")
        if "${" in scalars[0].text:
            raise NoText(
                f"'{name}' has a name in it, which an expression cannot fill in",
                "use it in a text, or write a text without ${…}",
            )
        return scalars[0].text

    def give(self, names: Iterable[str]) -> None:
        """Note that names have a value from here on."""
        self.given.update(names)

    def give_all(self) -> None:
        """Note that every name may have a value, as at the end of the tree."""
        self.given.update(self._written)

    def declared_type(self, name: str) -> FieldType:
        """Return the declared type for values that nodes assign to a name; ANY for none."""
        written = self._written.get(name)
        return written.type if written is not None and written.declared else FieldType.ANY

    def knows(self, name: str) -> bool:
        """Return whether a name is known to have a value, at any time, without using it."""
        return name in self._types or name in self._written

    def type_of(self, name: str) -> FieldType | None:
        """Return the type of a name and record its use; None if there is no such name."""
        self.used.add(name)
        return self._type_of(name)

    def _type_of(self, name: str) -> FieldType | None:
        if self._messages:
            head, _, path = name.partition(".")
            if path and head in self._messages:
                return self._messages[head].type_of(path)
        if name in self._types:
            return self._types[name]
        if name in self._written:
            return self._written[name].type
        if name.startswith(TEXT_PREFIX):
            return FieldType.TEXT
        return FieldType.ANY if self._lenient and "." not in name else None

    def parse(self, text: str) -> Expression:
        """Return the expression in a text, with the types that its names have here.

        Raises:
            ExpressionError: As in :func:`parse_expression`; an unknown name is not an error.
        """
        # Words that are not names, such as those in quotes, do no harm here.
        words = _WORD.findall(text)
        types = tuple([self._type_of(word) for word in words])
        ranges = tuple([self._ranges.get(word) for word in words])
        written = [self._written.get(word) for word in words]
        choices = tuple([one.choices if one is not None else () for one in written])
        labels = tuple([self._labels.get(word) for word in words])
        texts: dict[str, str] = {}
        for word in words:
            if word.startswith(TEXT_PREFIX):
                # A missing text is reported as a problem of the name.
                with suppress(NoText):
                    texts[word] = self._plain_text(word)
        return _parsed(text, types, ranges, labels, tuple(texts.items()), choices)

    def range_of(self, name: str) -> Range | None:
        """Return the range of a name's value; None if not declared."""
        return self._ranges.get(name)

    def domain_of(self, name: str) -> str:
        """Return the possible values of a name in words; empty if not declared."""
        if (known := self._ranges.get(name)) is not None:
            return f"{known.low:g} to {known.high:g}"
        written = self._written.get(name)
        return join_quoted(written.choices) if written is not None else ""

    def members(self, group: str) -> list[str]:
        """Return the names in a group such as ``person.``, without the prefix."""
        return [one.removeprefix(group) for one in self._types if one.startswith(group)]

    def problem(
        self, name: str, *, maybe_text: bool = False, beside: str = "", may_miss: bool = False
    ) -> tuple[str, str, str] | None:
        """Return code, message and hint if a name cannot be used.

        The name may be meant as a text to compare with the name ``beside``. A name that may be
        missing can be used before it has a value.
        """
        if name in self._types and not self._messages:
            self.used.add(name)
            return None
        if name.startswith(TEXT_PREFIX):
            try:
                self._plain_text(name)
            except NoText as missing:
                return missing.code, missing.message, missing.hint
            return None
        head, _, path = name.partition(".")
        if path and head in self._messages:
            problem = self._messages[head].problem(path)
            return ("unknown-ros-field", problem, "") if problem else None
        if self.type_of(name) is not None:
            return None if may_miss else self._too_early(name)
        messages = [f"{message}.…" for message in self._messages]
        own = [one for one in self._types if "." not in one]
        known = [*own, *self._written, *messages, *(one for one in self._types if "." in one)]
        if head in self._messages:
            return ("unknown-name", f"'{name}' is a whole message", f"name a field: {name}.data")
        hint = self._hidden.get(name) or self._hint(name, known, maybe_text, beside)
        return ("unknown-name", f"there is no name '{name[:80]}' here", hint)

    def _hint(self, name: str, known: list[str], maybe_text: bool, beside: str) -> str:
        if name == "mood.change":
            if "live.person" not in known:
                return "moods change only while a tree runs; name scene.mood, the mood before it"
            return "scene.yaml does not say which parameter is the mood; add 'mood: …' there"
        if maybe_text and name in ABSENT:
            return ABSENT_HINT
        hint = did_you_mean(name, known)
        if nearest(name, known) is not None:
            return hint
        head, _, last = name[:40].rpartition(".")
        if head.partition(".")[0] in ("msg", "result"):
            return f"name it where it comes in, 'outputs: {{x: {name[:40]}}}', and then x here"
        message = next(iter(self._messages), None)
        if message is not None:
            return f"a field of the message is named {message}.{last}"
        if maybe_text and known and "." not in name:
            kind = KINDS.get(self._type_of(beside) or FieldType.ANY)
            if name in [word for _, word in self._labels.get(beside, ())]:
                return f"compare label({beside}) with '{name}'"
            if kind is ValueKind.NUMBER or kind is ValueKind.BOOLEAN:
                return f"'{beside}' is {kind.one}: compare it with {kind.one}"
            return f"if it is meant as a text, put it in quotation marks: '{name}'"
        return hint

    def _too_early(self, name: str) -> tuple[str, str, str] | None:
        if name in self._types or name in self.given or name not in self._written:
            return None
        written = self._written[name]
        return (
            "no-value-yet",
            f"'{name}' has no value here yet: '{written.node}' in line {written.line} gives it "
            "one later",
            "move that node before this one, or give it a value before with 'set'",
        )


@lru_cache(maxsize=1024)
def _parsed(
    text: str,
    types: tuple[FieldType | None, ...],
    ranges: tuple[Range | None, ...],
    labels: tuple[Labels | None, ...],
    texts: tuple[tuple[str, str], ...],
    choices: tuple[tuple[str, ...], ...],
) -> Expression:
    """Return an expression from a cache, because files repeat the same ones."""
    words = _WORD.findall(text)
    known = dict(zip(words, types, strict=True))
    words_for = dict(zip(words, labels, strict=True))
    choices_for = dict(zip(words, choices, strict=True))
    return parse_expression(
        text,
        kind_of=lambda name: KINDS.get(known.get(name) or FieldType.ANY),
        unit_of=lambda name: DIMENSIONS.get(known.get(name) or FieldType.ANY),
        words_of={"clock.weekday": WEEKDAYS, "cancel.by": STOPPERS},
        range_of=dict(zip(words, ranges, strict=True)).get,
        labels_of=lambda name: ANY_LABELS if known.get(name) is None else words_for.get(name),
        texts=dict(texts),
        choices_of=lambda name: choices_for.get(name, ()),
    )


def scene_names(
    space: SceneSpace, groups: Iterable[str] = ("scene", "live")
) -> dict[str, FieldType]:
    """Return the names of scene values: ``scene.age``, ``scene.person``, …."""
    types: dict[str, FieldType] = {}
    for group in groups:
        names = space.profiles.names if group == "profile" else space.names
        types.update({f"{group}.{name}": FieldType.NUMBER for name in names})
        if group != "profile":
            types[f"{group}.person"] = FieldType.BOOLEAN
        if group == "live":
            types["live.stale"] = FieldType.BOOLEAN
    return types


CLOCK_NAMES = {HOUR: FieldType.INTEGER, "clock.weekday": FieldType.TEXT}
"""Names of the local time."""

RUN_NAMES = {
    "run.agent": FieldType.TEXT,
    "run.host": FieldType.TEXT,
    "run.person": FieldType.TEXT,
    "run.urgency": FieldType.INTEGER,
}
"""Names about the user of a ROS interface."""

PLACE_NAMES = {
    "place.frame": FieldType.TEXT,
    "place.x": FieldType.LENGTH,
    "place.y": FieldType.LENGTH,
    "place.heading": FieldType.ANGLE,
    "place.orientation_z": FieldType.NUMBER,
    "place.orientation_w": FieldType.NUMBER,
}
"""Names for the place that an input of a skill names."""

CANCEL_NAMES = {"cancel.by": FieldType.TEXT, "cancel.reason": FieldType.TEXT}
"""Names in ``on_cancel`` for who stopped the run, and why."""


def person_names(space: SceneSpace) -> dict[str, FieldType]:
    """Return the names of facts about a person who is known by name."""
    remembered = {f"person.{key}": kind for key, kind in space.remembers.items()}
    return {"person.name": FieldType.TEXT, "person.visits": FieldType.INTEGER, **remembered}


def mood_names(space: SceneSpace) -> dict[str, FieldType]:
    """Return ``mood.change`` if the system has a mood."""
    return {} if space.mood is None else {"mood.change": FieldType.NUMBER}


def tree_names(space: SceneSpace) -> dict[str, FieldType]:
    """Return the names that have a value from the start of a tree, except names of its file."""
    return {
        **scene_names(space, ("scene", "live", "profile")),
        **mood_names(space),
        **CLOCK_NAMES,
        **person_names(space),
    }


def scene_scope(space: SceneSpace, types: Mapping[str, FieldType]) -> NameScope:
    """Return a scope of names, with the ranges and labels of scene values."""
    return NameScope(types, ranges=scene_ranges(space), labels=scene_labels(space))


def scene_labels(space: SceneSpace) -> dict[str, Labels]:
    """Return the words for scene values by every name of these."""
    return {
        f"{group}.{one.name}": tuple(one.labels.items())
        for group in ("scene", "live", "profile")
        for one in space.parameters
    }


def scene_ranges(space: SceneSpace) -> dict[str, Range]:
    """Return the ranges of scene values and mood changes by every name of these."""
    ranges = {
        f"{group}.{one.name}": Range(one.minimum, one.maximum)
        for group in ("scene", "live", "profile")
        for one in space.parameters
    }
    if space.mood is not None:
        mood = space.parameter(space.mood)
        width = mood.maximum - mood.minimum
        ranges["mood.change"] = Range(-width, width)
    return ranges
