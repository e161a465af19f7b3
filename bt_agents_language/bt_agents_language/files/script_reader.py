# SPDX-License-Identifier: Apache-2.0
"""Reads a script: visits one after the other, for the demo and for experiments."""

from __future__ import annotations

from pathlib import Path

from bt_agents_core.scene import SceneSpace
from bt_agents_language.model.interfaces import read_ros_name
from bt_agents_language.model.scene_values import read_values
from bt_agents_language.model.specs import SceneChange, Script, Visit
from bt_agents_language.yaml.mapping_reader import MappingReader
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Node, Sequence

_VISIT_KEYS = ("label", "person", "urgent", "scene", "changes", "answers", "buttons")


def read_script(file: Path | Source, space: SceneSpace) -> Script:
    """Return the script of a file.

    Args:
        file: The file, or its text.
        space: The scene parameters.

    Raises:
        ReadError: There is a problem; it lists all of them.
    """
    reading = TypedReader.of(file)
    fields = reading.document("a script", ("title", "visits"), ("visits",))
    title = fields.text("title")
    nodes = fields.items("visits")
    if not nodes and isinstance(fields.get("visits"), Sequence):
        reading.error("missing-value", fields.nodes["visits"], "there is no visit", "add one")
    visits = [_visit(reading, node, space) for node in nodes]
    reading.problems.raise_if_any()
    return Script(title=title, visits=tuple(visit for visit in visits if visit is not None))


def _visit(reading: TypedReader, node: Node, space: SceneSpace) -> Visit | None:
    fields = reading.fields(node, "a visit", _VISIT_KEYS, ("label",))
    if fields is None:
        return None
    scene = fields.get("scene")
    person = fields.boolean("person")
    changes = [_change(reading, change, space) for change in fields.items("changes")]
    return Visit(
        label=fields.text("label"),
        person=True if person is None else person,
        values=read_values(reading, scene, "'scene'", space) if scene is not None else {},
        changes=tuple(
            sorted((c for c in changes if c is not None), key=lambda change: change.after_s)
        ),
        answers=_answers(reading, fields),
        buttons=_buttons(reading, fields),
        urgent=bool(fields.boolean("urgent")),
    )


def _change(reading: TypedReader, node: Node, space: SceneSpace) -> SceneChange | None:
    fields = reading.fields(node, "a change", ("after", "scene", "person"), ("after",))
    if fields is None:
        return None
    after_s = fields.duration("after")
    scene = fields.get("scene")
    person = fields.boolean("person")
    values = read_values(reading, scene, "'scene'", space) if scene is not None else {}
    if scene is None and fields.get("person") is None:
        reading.error(
            "missing-key", node, "a change needs 'scene' or 'person'", "add 'scene: {…}'"
        )
    return None if after_s is None else SceneChange(after_s=after_s, values=values, person=person)


def _answers(reading: TypedReader, fields: MappingReader) -> dict[str, str]:
    answers: dict[str, str] = {}
    for entry in fields.entries("answers", "words and answers"):
        text = reading.text(entry.value, "an answer")
        if text is not None:
            answers[entry.key.text] = text
    return answers


def _buttons(reading: TypedReader, fields: MappingReader) -> dict[str, str]:
    buttons: dict[str, str] = {}
    for entry in fields.entries("buttons", "topics and words"):
        topic = read_ros_name(reading, entry.key, "the topic of a button")
        words = reading.text(entry.value, "the words of the robot after which it is pressed")
        if topic is not None and words is not None:
            buttons[topic] = words
    return buttons
