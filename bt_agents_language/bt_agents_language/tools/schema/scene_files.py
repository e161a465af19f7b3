# SPDX-License-Identifier: Apache-2.0
"""JSON Schema of ``scene.yaml``: parameters, sources, persons and places."""

from __future__ import annotations

from bt_agents_core.scene import MAX_WEIGHT
from bt_agents_language.model.scene_specs import AddresseeRule, MissingRule
from bt_agents_language.tools.schema import value_schemas
from bt_agents_language.tools.schema.documents import document, listed, mapping
from bt_agents_language.tools.schema.value_schemas import Schema, described

_BRACKETS = r"^[A-Za-z~/_<][A-Za-z0-9_/~<>]*$"


def scene_schema() -> Schema:
    """Return the schema of ``scene.yaml``."""
    source: Schema = {"$ref": "#/definitions/source"}
    text_source: Schema = {"$ref": "#/definitions/text_source"}
    properties: dict[str, Schema] = {
        "place": described(
            {"anyOf": [value_schemas.text(), text_source]},
            "Where the robot is: a word, or the topic that says so.",
        ),
        "parameters": described(
            {**value_schemas.names(_parameter()), "minProperties": 1},
            "What every scene and every profile is described by.",
        ),
        "mood": described(value_schemas.text(), "The parameter whose change becomes feedback."),
        "no_person": described(
            _numbers("^[a-z][a-z0-9_]*$"), "Values of a scene in which nobody is there."
        ),
        "persons": described(_persons(), "Who is tracked, and whom a scene is about."),
        "sources": described(
            {
                "type": "object",
                "additionalProperties": {"anyOf": [source, {**listed(source), "minItems": 1}]},
            },
            "Parameter (or person) → where it comes from; several sources of one are fused.",
        ),
    }
    definitions = {"source": _source(), "text_source": mapping(_topic(), _TOPIC_REQUIRED)}
    return document(
        "Scene",
        "The scene parameters and their sources.",
        properties,
        ["parameters"],
        definitions,
    )


_TOPIC_REQUIRED = ["topic", "type", "field"]


def _parameter() -> Schema:
    number = value_schemas.number()
    return mapping(
        {
            "min": described(dict(number), "Smallest value."),
            "max": described(dict(number), "Largest value."),
            "default": described(dict(number), "The value that stands for 'nothing special'."),
            "description": described(value_schemas.text(), "What it means."),
            "labels": described(
                {
                    "type": "object",
                    "propertyNames": {"pattern": number["pattern"]},
                    "additionalProperties": value_schemas.text(),
                },
                "Words for some values: {1: a child}",
            ),
            "weight": described(
                value_schemas.number(0, MAX_WEIGHT) | {"default": 1},
                "How much it counts where distances are weighted.",
            ),
            "missing": described(
                {
                    "enum": [rule.value for rule in MissingRule],
                    "default": MissingRule.LEAVE_OUT.value,
                },
                "What stands for it while no source measures it: nothing (leave_out), what is "
                "known of the person or the place (estimate), or else the default (default).",
            ),
        },
        ["min", "max", "default"],
    )


def _topic() -> dict[str, Schema]:
    name: Schema = {
        "type": "string",
        "pattern": _BRACKETS,
        "patternErrorMessage": "expected words of letters, digits and '_' joined by '/'; "
        "<person> stands for the id of a person",
    }
    return {
        "topic": described(name, "Where the readings come from: persons/<person>/age"),
        "type": described(value_schemas.ros_type(), "ROS type of the topic."),
        "field": described(
            value_schemas.text(),
            "Path of the field, data or faces.0.mood, or an expression over msg.*",
        ),
        "stale_after": described(value_schemas.duration(), "An older reading counts as missing."),
        "latched": described(
            value_schemas.boolean(), "Whether the last message is kept for those who come later."
        ),
    }


def _source() -> Schema:
    number = value_schemas.number()
    properties = {
        "from": described(
            {"enum": ["tracked"]}, "Read the item of each person in the list of 'tracked'."
        ),
        **_topic(),
        "map": described(
            _numbers(str(number["pattern"])),
            "Reading → value of the parameter; linear in between.",
        ),
        "table": described(
            {"type": "object", "additionalProperties": dict(number), "minProperties": 1},
            "Word → value of the parameter.",
        ),
        "confidence": described(
            value_schemas.text(),
            "0, not measured, to 1: a field, an expression over msg.* or a number.",
        ),
        "std": described(
            value_schemas.text(),
            "Standard deviation of the reading: a field, an expression over msg.* or a number.",
        ),
        "smoothing": described(
            value_schemas.duration(), "Time constant: after so long a reading counts by a third."
        ),
    }
    return mapping(properties, []) | {
        "anyOf": [
            {"required": ["from", "field"]},
            {
                "required": _TOPIC_REQUIRED,
                "anyOf": [
                    {"required": [key], "errorMessage": "add 'stale_after: 2 s'"}
                    for key in ("stale_after", "latched")
                ],
            },
        ]
    }


def _persons() -> Schema:
    source: Schema = {"$ref": "#/definitions/source"}
    tracked = mapping(
        {
            **_topic(),
            "field": described(value_schemas.text(), "Path of the list of ids, or of items."),
            "id": described(value_schemas.text(), "Path of a person's id in an item of the list."),
            "lost_after": described(
                value_schemas.duration() | {"default": "1 s"},
                "Who has not been in the list for so long is gone.",
            ),
        },
        _TOPIC_REQUIRED,
    )
    rules = [rule.value for rule in AddresseeRule]
    addressee = mapping(
        {
            "rule": described({"enum": rules}, "The most engaged, the nearest or the first."),
            "source": described(
                source, "How engaged a person is, more is better, or how far away, less is."
            ),
            "better_by": described(
                value_schemas.length() | {"default": 0},
                "So much better must another person be, in the unit of the source; a distance may "
                "be written as a length.",
            ),
            "for": described(
                value_schemas.duration() | {"default": "1 s"},
                "For so long must the other be better.",
            ),
        },
        ["rule"],
    )
    return mapping(
        {
            "tracked": described(tracked, "Where it is said who is there."),
            "parts": described(
                value_schemas.names({"$ref": "#/definitions/text_source"}),
                "Parts of a person with ids of their own, such as the face.",
            ),
            "known": described(source, "Whether the id of a person is a name: 0.5 or more."),
            "addressee": described(
                {"anyOf": [{"enum": [AddresseeRule.FIRST.value]}, addressee]},
                "Whom of several persons a scene is about.",
            ),
        },
        ["tracked"],
    )


def _numbers(names: str) -> Schema:
    return {
        "type": "object",
        "propertyNames": {"pattern": names},
        "additionalProperties": value_schemas.number(),
    }
