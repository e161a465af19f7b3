# SPDX-License-Identifier: Apache-2.0
"""Reads ``scene.yaml``: the parameters of every scene and the sources that feed them."""

from __future__ import annotations

import re
from pathlib import Path

from bt_agents.language import quantities
from bt_agents.language.diagnostics import did_you_mean, shown
from bt_agents.language.fields import Fields
from bt_agents.language.interfaces import Interfaces, read_ros_name, read_ros_type
from bt_agents.language.shape import FileReading
from bt_agents.language.specs import BindingKind, SceneSpec, SourceSpec
from bt_agents.language.text.source import Source
from bt_agents.language.text.yaml_reader import Entry, Mapping, Node
from bt_agents.scene import SceneParameter, SceneSpace

PERSON = "person"
"""What the source of the presence of a person is called; no parameter can be called so."""

_TAKEN = {
    PERSON: "whether a person is there",
    "stale": "whether the live scene is too old to count",
}

_FIELD_PATH = re.compile(r"[a-z][a-z0-9_]*(\.[a-z0-9_]+)*")


def read_scene(path: Path, interfaces: Interfaces | None = None) -> SceneSpec:
    """Return the scene parameters and sources of a file.

    Raises:
        ReadError: There is a problem; it lists all of them.
    """
    return _read(FileReading.of(path), interfaces)


def read_scene_text(text: str, file: str, interfaces: Interfaces | None = None) -> SceneSpec:
    """Return the scene parameters and sources of a text; as :func:`read_scene`."""
    return _read(FileReading(Source(file, text)), interfaces)


def _read(reading: FileReading, interfaces: Interfaces | None) -> SceneSpec:
    fields = reading.document("scene.yaml", ("parameters", "mood", "sources"), ("parameters",))
    entries = fields.entries("parameters", "names and parameters")
    if not entries and isinstance(fields.get("parameters"), Mapping):
        reading.error(
            "missing-value", fields.nodes["parameters"], "there is no parameter", "add one"
        )
    read = [(entry.key.text, _parameter(reading, entry)) for entry in entries]
    parameters = {name: parameter for name, parameter in read if parameter is not None}
    names = [name for name, _ in read]
    mood = _mood(reading, fields, names)
    sources: dict[str, SourceSpec] = {}
    for entry in fields.entries("sources", "parameters and sources"):
        if entry.key.text != PERSON and entry.key.text not in names:
            reading.error(
                "unknown-name",
                entry.key,
                f"there is no scene parameter {shown(entry.key.text)}",
                did_you_mean(entry.key.text, [PERSON, *names]),
            )
            continue
        source = _source(reading, entry, parameters.get(entry.key.text), interfaces)
        if source is not None:
            sources[source.parameter] = source
    reading.problems.raise_if_any()
    person = sources.pop(PERSON, None)
    return SceneSpec(
        space=SceneSpace(parameters=tuple(parameters.values()), mood=mood),
        sources=tuple(sources.values()),
        person=person,
    )


def _parameter(reading: FileReading, entry: Entry) -> SceneParameter | None:
    name = reading.name(entry.key, "the name of a scene parameter")
    if name in _TAKEN:
        reading.error(
            "name-taken",
            entry.key,
            f"'{name}' has a meaning of its own: {_TAKEN[name]}",
            "choose another name",
        )
    what = f"parameter '{entry.key.text[:40]}'"
    fields = reading.fields(
        entry.value, what, ("min", "max", "default", "description", "labels"),
        ("min", "max", "default"),
    )  # fmt: skip
    if fields is None:
        return None
    minimum, maximum = fields.number("min"), fields.number("max")
    if not fields.check_range(what, minimum, maximum):
        minimum = maximum = None
    default = fields.number("default", minimum, maximum)
    labels = _labels(reading, fields, minimum, maximum)
    description = fields.text("description")
    if name is None or minimum is None or maximum is None or default is None:
        return None
    return SceneParameter(
        name=name,
        minimum=minimum,
        maximum=maximum,
        default=default,
        description=description,
        labels=labels,
    )


def _labels(
    reading: FileReading, fields: Fields, minimum: float | None, maximum: float | None
) -> dict[float, str]:
    labels: dict[float, str] = {}
    for entry in fields.entries("labels", "values and words"):
        value = reading.number(entry.key, "the value of a label", minimum, maximum)
        text = reading.text(entry.value, "a label")
        if value in labels:
            reading.error("duplicate-key", entry.key, f"the value {value:g} has a label already")
        if value is not None and text is not None:
            labels[value] = text
    return labels


def _mood(reading: FileReading, fields: Fields, names: list[str]) -> str | None:
    node = fields.get("mood")
    mood = reading.text(node, "'mood'") if node is not None else None
    if node is None or mood is None or mood in names:
        return mood
    reading.error(
        "unknown-name",
        node,
        f"there is no scene parameter {shown(mood)}",
        did_you_mean(mood, names),
    )
    return None


def _source(
    reading: FileReading,
    entry: Entry,
    parameter: SceneParameter | None,
    interfaces: Interfaces | None,
) -> SourceSpec | None:
    name = entry.key.text
    keys = ("topic", "type", "field", "stale_after")
    fields = reading.fields(
        entry.value, f"source '{name}'", keys if name == PERSON else (*keys, "map"), keys
    )
    if fields is None:
        return None
    nodes = fields.nodes
    topic = read_ros_name(reading, nodes["topic"], "'topic'") if "topic" in nodes else None
    type_name = (
        read_ros_type(reading, nodes["type"], BindingKind.TOPIC, interfaces)
        if "type" in nodes
        else None
    )
    field = _field(reading, nodes["field"], type_name, interfaces) if "field" in nodes else None
    points = _points(reading, nodes["map"], parameter) if "map" in nodes else ()
    stale_after_s = fields.duration("stale_after")
    if stale_after_s == 0.0:
        reading.error(
            "out-of-range", nodes["stale_after"], "'stale_after' must be longer than 0 s"
        )
    if topic is None or type_name is None or field is None or stale_after_s is None:
        return None
    return SourceSpec(
        parameter=name,
        topic=topic,
        type=type_name,
        field=field,
        points=points,
        stale_after_s=stale_after_s,
        position=entry.key.position,
    )


def _field(
    reading: FileReading, node: Node, type_name: str | None, interfaces: Interfaces | None
) -> str | None:
    text = reading.text(node, "'field'")
    if text is None:
        return None
    if not _FIELD_PATH.fullmatch(text) or len(text) > 255:
        reading.error(
            "bad-name",
            node,
            f"'field' is {shown(text)}, expected the path of a field such as data or faces.0.mood",
            "write field names joined by points",
        )
        return None
    if interfaces is not None and type_name is not None:
        problem = interfaces.field_problem(BindingKind.TOPIC, type_name, "message", text)
        if problem:
            reading.error("unknown-ros-field", node, f"{type_name}: {problem}")
            return None
    return text


def _points(
    reading: FileReading, node: Node, parameter: SceneParameter | None
) -> tuple[tuple[float, float], ...]:
    """Return a linear map as (reading, value) pairs, readings rising."""
    points: dict[float, float] = {}
    entries = reading.entries(node, "'map'", "readings and values")
    limits = (parameter.minimum, parameter.maximum) if parameter is not None else (None, None)
    for entry in entries:
        value = reading.number(entry.value, "a value of 'map'", *limits)
        try:
            at = quantities.number(entry.key.text)
        except quantities.QuantityError as error:
            reading.error("bad-number", entry.key, f"a reading: {error.message}", error.hint)
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
