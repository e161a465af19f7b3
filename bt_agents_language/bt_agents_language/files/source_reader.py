# SPDX-License-Identifier: Apache-2.0
"""Reader of sources in ``scene.yaml``: topic, field, map or table, and certainty of readings."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import partial

from bt_agents_core.field_types import BindingKind
from bt_agents_core.scene import SceneParameter
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.expression import quantities
from bt_agents_language.expression.expression_values import EvaluationError, ValueKind
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.fields.interfaces import (
    Interfaces,
    MessageFields,
    Nesting,
    read_ros_name,
    read_ros_type,
)
from bt_agents_language.fields.references import read_expression
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.scene_specs import (
    LARGEST_STD,
    MESSAGE,
    PERSON,
    SourceSpec,
    TrackedSpec,
    path_of,
    word_of,
)
from bt_agents_language.yaml.field_tables import (
    BOOLEAN,
    DURATION,
    NUMBER,
    ROS_TYPE,
    TEXT,
    Entries,
    FieldDecl,
    Form,
    Key,
    KeyTable,
    Needs,
    Single,
    WordChoice,
)
from bt_agents_language.yaml.scalars import boolean
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence

TRACKED = "tracked"
"""Value of ``from`` for the list of tracked persons."""

TOPIC = KeyTable(
    fields=(
        FieldDecl(
            "topic",
            Single(Form.ROS_NAME, placeholders=True),
            "Topic of the readings: persons/<person>/age",
            required=True,
        ),
        FieldDecl("type", ROS_TYPE, "ROS type of the topic.", required=True),
        FieldDecl(
            "field",
            TEXT,
            "Path of the field, such as data or faces.0.mood, or an expression over msg.*",
            required=True,
        ),
        FieldDecl("stale_after", DURATION, "An older reading counts as missing."),
        FieldDecl(
            "latched",
            BOOLEAN,
            "Whether the publisher keeps the last message for later subscribers.",
        ),
    )
)
"""Keys of every source, which are enough for a source of texts."""

SOURCE = KeyTable(
    fields=(
        FieldDecl(
            "from",
            WordChoice((TRACKED,)),
            "Read the item of each person in the list of 'tracked'.",
        ),
        *(replace(one, required=False) for one in TOPIC.fields),
        FieldDecl(
            "map",
            Entries(NUMBER, "readings and values", keys=Key.NUMBER),
            "Reading → value of the parameter; linear in between.",
        ),
        FieldDecl(
            "table",
            Entries(
                NUMBER,
                "words and values",
                keys=Key.ANY,
                empty="'table' is empty",
                add="add a word",
            ),
            "Word → value of the parameter.",
        ),
        FieldDecl(
            "confidence",
            TEXT,
            "0 (not measured) to 1: a field, an expression over msg.* or a number.",
        ),
        FieldDecl(
            "std",
            TEXT,
            "Standard deviation of the reading: a field, an expression over msg.* or a number.",
        ),
        FieldDecl(
            "smoothing", DURATION, "Time constant: after this time a reading counts by a third."
        ),
    ),
    needs=Needs(
        options=(
            Needs(("from", "field")),
            Needs(
                TOPIC.required,
                options=tuple(
                    Needs((key,), hint="add 'stale_after: 2 s'")
                    for key in ("stale_after", "latched")
                ),
            ),
        )
    ),
)
"""Keys of a source of values."""

MAP_KEYS = ("map", "table", "smoothing")
VALUE_KEYS = (*MAP_KEYS, "confidence", "std")

_FIELD_PATH = re.compile(r"[a-z][a-z0-9_]*(\.[a-z0-9_]+)*")
_PATH_LIKE = re.compile(r"[^\W\d][\w.\[\]]*[\[\]_\w]")
_INDEX = re.compile(r"\[([0-9]+)\]")
_PERCENT = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*%")
_PLACEHOLDER = re.compile(r"<([^<>/]*)>")
_NUMBERS = (None, ValueKind.BOOLEAN, ValueKind.NUMBER)


@dataclass(frozen=True, kw_only=True)
class SourceContext:
    """Purpose of a source, which determines its allowed form.

    Attributes:
        name: Name of the parameter, or of the other purpose.
        what: The source in words, for messages.
        keys: Keys in addition to the keys of the topic.
        parameter: The scene parameter that it feeds; None for any value.
        may_be_per_person: Whether its topic may name a person, or ``from`` their list.
        must_be_per_person: Whether it must do so.
    """

    name: str
    what: str
    keys: tuple[str, ...] = ()
    parameter: SceneParameter | None = None
    text: bool = False
    may_be_per_person: bool = True
    must_be_per_person: bool = False


class SourceReader:
    """Reader of the sources in one file.

    Args:
        tracked: Source of tracked persons; None if persons are not distinguished.
        placeholders: Allowed names in angle brackets in a topic.
    """

    def __init__(
        self,
        reading: TypedReader,
        interfaces: Interfaces | None,
        tracked: TrackedSpec | None = None,
        placeholders: Collection[str] = (),
    ) -> None:
        self._reading = reading
        self._interfaces = interfaces
        self._tracked = tracked
        self._placeholders = placeholders

    def read_all(self, node: Node, where: Node, wanted: SourceContext) -> list[SourceSpec]:
        """Return one source or a list of them; report and omit wrong ones.

        Reports about the whole list point at ``where``.
        """
        if not isinstance(node, Sequence):
            source = self.read(node, where, wanted)
            return [source] if source is not None else []
        if not node.items:
            self._reading.error("missing-value", node, f"{wanted.what} is an empty list")
        return [*readable(self.read(item, item, wanted) for item in node.items)]

    def read(self, node: Node, where: Node, wanted: SourceContext) -> SourceSpec | None:
        """Return a source, or report that it is wrong and return None."""
        if isinstance(node, Mapping) and any(e.key.text == "from" for e in node.entries):
            return self._of_tracked(node, where, wanted)
        table = SOURCE.only((*TOPIC.values, *wanted.keys))
        fields = self.topic_fields(node, wanted.what, table)
        if fields is None:
            return None
        type_name = self.type_name(fields)
        return self._spec(
            fields,
            where,
            wanted,
            self.message(type_name),
            topic=self.topic(fields, wanted),
            type_name=type_name,
            stale_after_s=self.stale_after(fields),
            latched=fields.boolean("latched") or False,
        )

    def _of_tracked(self, node: Mapping, where: Node, wanted: SourceContext) -> SourceSpec | None:
        known = SOURCE.only(("from", "field", "stale_after", *wanted.keys))
        fields = self._reading.keys(node, known, wanted.what, required=("from", "field"))
        if fields is None or fields.choice("from") is None:
            return None
        tracked = self._tracked
        if tracked is None or not tracked.id or not wanted.may_be_per_person:
            message, hint = f"{wanted.what} is not about one person", "name a topic"
            if wanted.may_be_per_person:
                message = "there is no list of tracked persons with an item for each"
                hint += ", or say in 'persons: tracked' what the 'id' in each item is"
            self._reading.error("unknown-name", fields.nodes["from"], message, hint)
            return None
        own = "stale_after" in fields.nodes
        return self._spec(
            fields,
            where,
            wanted,
            self.message(tracked.type, f"{tracked.field}.0"),
            topic=tracked.topic,
            type_name=tracked.type,
            stale_after_s=self.stale_after(fields) if own else tracked.stale_after_s,
            latched=tracked.latched,
            of_item=True,
        )

    def _spec(
        self,
        fields: MappingReader,
        where: Node,
        wanted: SourceContext,
        message: MessageFields,
        *,
        topic: str | None,
        type_name: str | None,
        stale_after_s: float | None,
        latched: bool,
        of_item: bool = False,
    ) -> SourceSpec | None:
        reads = self._field(fields, wanted, message)
        points = _points(self._reading, fields, wanted.parameter)
        kind = reads.kind if reads is not None else None
        table = _table(self._reading, fields, wanted.parameter, kind)
        confidence = self._certainty(fields, "confidence", message, 1.0)
        std = self._certainty(fields, "std", message, LARGEST_STD)
        smoothing_s = fields.duration("smoothing") or 0.0
        if reads is None or topic is None or type_name is None or stale_after_s is None:
            return None
        return SourceSpec(
            parameter=wanted.name,
            topic=topic,
            type=type_name,
            field=reads,
            points=points,
            table=table,
            stale_after_s=stale_after_s,
            latched=latched,
            confidence=confidence,
            std=std,
            smoothing_s=smoothing_s,
            of_item=of_item,
            position=where.position,
        )

    # Topics

    def topic_fields(self, node: Node, what: str, table: KeyTable) -> MappingReader | None:
        """Return the keys of a topic and further keys of a table; None if it is not a mapping."""
        required = (*TOPIC.required, *(() if is_latched(node) else ("stale_after",)))
        return self._reading.keys(node, table, what, required=required)

    def topic(self, fields: MappingReader, wanted: SourceContext) -> str | None:
        """Return the name of a topic, with checked names in angle brackets."""
        topic = fields.read("topic", partial(read_ros_name, self._reading, brackets=True))
        if topic is None:
            return None
        node, named = fields.nodes["topic"], _PLACEHOLDER.findall(topic)
        if wanted.must_be_per_person and not named:
            self._reading.error(
                "wrong-value",
                node,
                f"{wanted.what} has the same topic for everybody",
                f"write <{PERSON}> where the topic has the id of the person",
            )
            return None
        return topic if all(self._is_known(node, name, wanted) for name in named) else None

    def _is_known(self, node: Node, name: str, wanted: SourceContext) -> bool:
        if wanted.may_be_per_person and name in self._placeholders:
            return True
        if not wanted.may_be_per_person:
            message, hint = f"{wanted.what} is not about one person", "name a topic without < >"
        elif not self._placeholders:
            message = f"<{name[:40]}> in a topic needs 'persons', which says who is tracked"
            hint = "add 'persons: {tracked: …}'"
        else:
            message = f"there is no id called <{name[:40]}>"
            hint = did_you_mean(name, self._placeholders)
        self._reading.error("unknown-name", node, message, hint)
        return False

    def type_name(self, fields: MappingReader) -> str | None:
        """Return the checked ROS type in ``type``."""
        node = fields.get("type")
        if node is None:
            return None
        return read_ros_type(self._reading, node, BindingKind.TOPIC, self._interfaces)

    def message(self, type_name: str | None, inside: str = "") -> MessageFields:
        """Return the fields of a message, or of a part of it."""
        return MessageFields(
            self._interfaces, BindingKind.TOPIC, type_name or "", "message", inside
        )

    def stale_after(self, fields: MappingReader) -> float | None:
        """Return how long a reading counts [s], infinite if not given; None if wrong."""
        if "stale_after" not in fields.nodes:
            return math.inf if is_latched(fields.mapping) else None
        seconds = fields.duration("stale_after")
        if seconds == 0.0:
            node = fields.nodes["stale_after"]
            self._reading.error("out-of-range", node, "'stale_after' must be longer than 0 s")
        return seconds

    # Readings

    def path(self, node: Node, what: str, message: MessageFields) -> str | None:
        """Return the path of a field of a message."""
        text = self._reading.text(node, what)
        if text is None:
            return None
        if not _FIELD_PATH.fullmatch(text) or len(text) > 255:
            meant = _INDEX.sub(r".\1", text[:80])
            sound = _FIELD_PATH.fullmatch(meant)
            self._reading.error(
                "bad-name",
                node,
                f"{what} is {quote(text)}, expected the path of a field such as data or "
                "faces.0.mood",
                f"write {meant}" if sound else "write field names joined by points",
            )
            return None
        problem = message.problem(text)
        if problem:
            self._reading.error("unknown-ros-field", node, f"{message.type_name}: {problem}")
            return None
        return text

    def _field(
        self, fields: MappingReader, wanted: SourceContext, message: MessageFields
    ) -> Expression | None:
        node = fields.get("field")
        if node is None:
            return None
        expression = self._expression(node, "'field'", message)
        if expression is None:
            return None
        kind = expression.kind
        if wanted.text:
            if kind in (None, ValueKind.TEXT):
                return expression
            expected, hint = "a text", "name a field that holds a text"
        elif "table" in fields.nodes:
            if kind is not ValueKind.LIST:
                return expression
            expected, hint = "one value", "pick an item by its number: list.0"
        elif kind in _NUMBERS:
            return expression
        else:
            expected = "a number, or true or false"
            hint = (
                "say which value each word means: table: {happy: 5, sad: 1}"
                if kind is ValueKind.TEXT and "table" in wanted.keys
                else "compare it: msg.name == 'anna'"
            )
        assert kind is not None
        self._reading.error(
            "bad-expression", node, f"'field' is {kind.one}, expected {expected}", hint
        )
        return None

    def _expression(self, node: Node, what: str, message: MessageFields) -> Expression | None:
        """Return an expression over the fields of a message; a field path is one, too.

        A plain field must hold a single value, as far as its type is known.
        """
        text = self._reading.text(node, what)
        if text is None:
            return None
        assert isinstance(node, Scalar)
        names = NameScope({}, messages={MESSAGE: message})
        plain = _PATH_LIKE.fullmatch(text) and not text.startswith(f"{MESSAGE}.")
        if plain and text not in ("true", "false"):
            path = self.path(node, what, message)
            expression = None if path is None else names.parse(f"{MESSAGE}.{path}")
        else:
            expression = read_expression(self._reading, node, node.text, 0, what, names)
        path = path_of(expression) if expression is not None else None
        nested = message.nested(path) if path is not None else None
        if nested is None:
            return expression
        item = nested is Nesting.LIST
        hint = f"pick an item of it: {path}.0" if item else f"name a field of it: {path}.…"
        problem = f"{what} is {nested.value}, expected one value"
        self._reading.error("bad-expression", node, problem, hint)
        return None

    def _certainty(
        self, fields: MappingReader, key: str, message: MessageFields, largest: float
    ) -> Expression | None:
        """Return an expression for the confidence or the standard deviation of readings."""
        node = fields.get(key)
        if node is None:
            return None
        percent = _PERCENT.fullmatch(node.text) if isinstance(node, Scalar) else None
        if percent is not None:
            of_range = f"write {float(percent[1]) / 100:g}"
            hint = "write a number in the unit of the reading" if key == "std" else of_range
            self._reading.error(
                "bad-number", node, f"'{key}': expected a number, found {quote(percent[0])}", hint
            )
            return None
        expression = self._expression(node, f"'{key}'", message)
        if expression is None:
            return None
        if expression.kind not in _NUMBERS:
            self._reading.error(
                "bad-expression",
                node,
                f"'{key}' is {expression.kind.one}, expected a number",
                "name a field that holds a number, or write one",
            )
            return None
        try:
            constant = None if expression.names else expression.evaluate(_no_name)
        except EvaluationError as error:
            self._reading.error("bad-expression", node, f"'{key}': {error.message}", error.hint)
            return None
        if isinstance(constant, int | float):
            top = None if key == "std" and constant <= largest else largest
            self._reading.in_range(node, f"'{key}'", constant, 0.0, top)
            if key == "confidence" and constant == 0:
                self._reading.error(
                    "out-of-range",
                    node,
                    "'confidence' is always 0, which means that nothing was measured",
                    "write a number above 0, up to 1",
                )
        return expression


def is_latched(node: Node) -> bool:
    """Return whether a mapping declares its topic as latched; a wrong word may mean so."""
    if not isinstance(node, Mapping):
        return False
    written = [entry.value for entry in node.entries if entry.key.text == "latched"]
    return any(not isinstance(one, Scalar) or boolean(one.text) is not False for one in written)


def _no_name(name: str) -> float:
    raise KeyError(name)


def _points(
    reading: TypedReader, fields: MappingReader, parameter: SceneParameter | None
) -> tuple[tuple[float, float], ...]:
    """Return the linear map in ``map`` as (reading, value) pairs, with rising readings."""
    points: dict[float, float] = {}
    entries = fields.entries("map")
    for entry in entries:
        value = reading.number(entry.value, "a value of 'map'", *_limits(parameter))
        try:
            at = quantities.number(entry.key.text)
        except quantities.QuantityError as error:
            hint = "words and their values go under 'table' instead of 'map'"
            reading.error(
                "bad-number", entry.key, f"a reading: {error.message}", error.hint or hint
            )
            continue
        if at in points:
            reading.error("duplicate-key", entry.key, f"the reading {at:g} stands here again")
        if value is not None:
            points[at] = value
    if entries and len(entries) < 2:
        reading.error(
            "missing-value",
            fields.nodes["map"],
            "'map' needs two readings or more",
            "add the other end of the range",
        )
    return tuple(sorted(points.items()))


def _table(
    reading: TypedReader,
    fields: MappingReader,
    parameter: SceneParameter | None,
    kind: ValueKind | None,
) -> tuple[tuple[str, float], ...]:
    """Return the words in ``table``, in the form of readings of a kind, with their values."""
    if {"map", "table"} <= fields.nodes.keys():
        reading.error(
            "unknown-key",
            fields.keys["table"],
            "beside 'map' there is no 'table'",
            "keep 'map' for numbers or 'table' for words",
        )
    table: dict[str, float] = {}
    for entry in fields.entries("table"):
        value = reading.number(entry.value, "a value of 'table'", *_limits(parameter))
        word = _word(reading, entry.key, kind)
        if word in table and word != entry.key.text:
            reading.error("duplicate-key", entry.key, f"the reading {word} stands here again")
        if value is not None and word is not None:
            table[word] = value
    return tuple(table.items())


def _word(reading: TypedReader, node: Scalar, kind: ValueKind | None) -> str | None:
    """Return a word of a table in the form of readings of a kind; None if it is wrong."""
    if kind is ValueKind.BOOLEAN:
        truth = reading.boolean(node, "a reading in 'table'")
        return None if truth is None else str(truth).lower()
    if kind is ValueKind.NUMBER:
        number = reading.number(node, "a reading in 'table'")
        return None if number is None else word_of(number)
    return node.text


def _limits(parameter: SceneParameter | None) -> tuple[float | None, float | None]:
    return (parameter.minimum, parameter.maximum) if parameter is not None else (None, None)
