# SPDX-License-Identifier: Apache-2.0
"""Mappings from readings to values of a scene parameter: linear, or a table of words."""

from __future__ import annotations

from bt_agents_core.scene import SceneParameter
from bt_agents_language.expression import quantities
from bt_agents_language.expression.expression_values import ValueKind
from bt_agents_language.model.scene_specs import word_of
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import Scalar


def read_points(
    reading: TypedReader, fields: MappingReader, parameter: SceneParameter | None
) -> tuple[tuple[float, float], ...]:
    """Return the linear map behind ``map`` as (reading, value) pairs, readings rising."""
    node = fields.get("map")
    if node is None:
        return ()
    points: dict[float, float] = {}
    entries = fields.entries("map")
    for entry in entries:
        value = reading.number(entry.value, "a value of 'map'", *_limits(parameter))
        try:
            at = quantities.number(entry.key.text)
        except quantities.QuantityError as error:
            hint = "words and their values stand behind 'table' instead of 'map'"
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
            node,
            "'map' needs two readings or more",
            "add the other end of the range",
        )
    return tuple(sorted(points.items()))


def read_table(
    reading: TypedReader,
    fields: MappingReader,
    parameter: SceneParameter | None,
    kind: ValueKind | None,
) -> tuple[tuple[str, float], ...]:
    """Return the words behind ``table``, as readings of a kind are, and their values."""
    node = fields.get("table")
    if node is None:
        return ()
    if "map" in fields.nodes:
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
    """Return a word of a table as readings of a kind are looked up in it; None for a wrong one."""
    if kind is ValueKind.BOOLEAN:
        truth = reading.boolean(node, "a reading in 'table'")
        return None if truth is None else str(truth).lower()
    if kind is ValueKind.NUMBER:
        number = reading.number(node, "a reading in 'table'")
        return None if number is None else word_of(number)
    return node.text


def _limits(parameter: SceneParameter | None) -> tuple[float | None, float | None]:
    return (parameter.minimum, parameter.maximum) if parameter is not None else (None, None)
