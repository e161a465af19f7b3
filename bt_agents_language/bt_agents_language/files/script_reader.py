# SPDX-License-Identifier: Apache-2.0
"""Reader of scripts: sequences of visits, for the demo and for experiments."""

from __future__ import annotations

from pathlib import Path

from bt_agents_core.scene import SceneSpace
from bt_agents_language.fields.interfaces import read_ros_name
from bt_agents_language.fields.scene_values import read_values
from bt_agents_language.model.specs import SceneChange, Script, Visit
from bt_agents_language.yaml.field_tables import (
    BOOLEAN,
    DURATION,
    TEXT,
    Entries,
    FieldDecl,
    FileKind,
    Items,
    Key,
    KeyTable,
    SceneValues,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Node

LONGEST_NAME = 100
"""Longest name of a person in characters."""

_PERSON = FieldDecl("person", BOOLEAN, "Whether a person is there.")
_CHANGE = KeyTable(
    what="a change",
    fields=(
        FieldDecl("after", DURATION, "Time since the start of the agent's run.", required=True),
        FieldDecl("scene", SceneValues(), "Scene parameters with their new values."),
        _PERSON,
    ),
)
_VISIT = KeyTable(
    what="a visit",
    fields=(
        FieldDecl("label", TEXT, "Who comes, in words.", required=True),
        _PERSON,
        FieldDecl(
            "name", TEXT, "Name of the person, for person.name; an unknown person if left out."
        ),
        FieldDecl(
            "urgent",
            BOOLEAN,
            "Whether the scene may stop a running tree at once, if new scenes preempt.",
        ),
        FieldDecl("scene", SceneValues(), "Measured values; all other values are missing."),
        FieldDecl("changes", Items(_CHANGE), "What changes during the visit."),
        FieldDecl(
            "answers",
            Entries(TEXT, "words and answers", keys=Key.ANY),
            "Words in a question → the person's answer.",
        ),
        FieldDecl(
            "buttons",
            Entries(TEXT, "topics and words", keys=Key.TOPIC),
            "Topic of a button → words of the robot after which the person presses it.",
        ),
    ),
)
SCRIPT = FileKind(
    name="script",
    what="a script",
    title="Script",
    description="Visits, for the demo and for experiments.",
    fields=(
        FieldDecl("title", TEXT, "Name for people."),
        FieldDecl(
            "visits",
            Items(_VISIT, empty="there is no visit"),
            "Visits, one after another.",
            required=True,
        ),
    ),
)


def read_script(file: Path | Source, space: SceneSpace) -> Script:
    """Return the script of a file, or raise a ``ReadError`` with all problems."""
    with TypedReader.of(file) as reading:
        fields = reading.file(SCRIPT)
        title = fields.text("title")
        visits = readable(_visit(reading, node, space) for node in fields.items("visits"))
        reading.problems.raise_if_any()
        return Script(title=title, visits=visits)


def _visit(reading: TypedReader, node: Node, space: SceneSpace) -> Visit | None:
    fields = reading.keys(node, _VISIT)
    if fields is None:
        return None
    scene = fields.get("scene")
    person = fields.boolean("person")
    changes = readable(_change(reading, change, space) for change in fields.items("changes"))
    return Visit(
        label=fields.text("label"),
        person=True if person is None else person,
        values=read_values(reading, scene, "'scene'", space) if scene is not None else {},
        changes=tuple(sorted(changes, key=lambda change: change.after_s)),
        answers=_answers(reading, fields),
        buttons=_buttons(reading, fields),
        urgent=bool(fields.boolean("urgent")),
        name=_name(reading, fields, person),
    )


def _name(reading: TypedReader, fields: MappingReader, person: bool | None) -> str:
    name = fields.text("name")
    if name and person is False:
        reading.error(
            "misplaced-key",
            fields.keys["name"],
            "nobody is there, so nobody has a name",
            "remove 'name', or 'person: false'",
        )
    if len(name) > LONGEST_NAME or not name.isprintable():
        reading.error(
            "bad-name",
            fields.nodes["name"],
            f"the name of a person is one line of at most {LONGEST_NAME} characters",
            "write a shorter one",
        )
    return name


def _change(reading: TypedReader, node: Node, space: SceneSpace) -> SceneChange | None:
    fields = reading.keys(node, _CHANGE)
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
    entries = fields.entries("answers")
    answers = {entry.key.text: reading.text(entry.value, "an answer") for entry in entries}
    return {words: answer for words, answer in answers.items() if answer is not None}


def _buttons(reading: TypedReader, fields: MappingReader) -> dict[str, str]:
    buttons: dict[str, str] = {}
    for entry in fields.entries("buttons"):
        topic = read_ros_name(reading, entry.key, "the topic of a button")
        words = reading.text(entry.value, "the words of the robot after which it is pressed")
        if topic is not None and words is not None:
            buttons[topic] = words
    return buttons
