# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of the files about scenes: ``scene.yaml``, scripts of visits and experiments."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.tools.schema import value_schemas
from bt_agents_language.tools.schema.value_schemas import Schema, described
from bt_agents_language.yaml.typed_reader import FORMAT

DRAFT = "http://json-schema.org/draft-07/schema#"


def document(
    title: str,
    description: str,
    properties: Mapping[str, Schema],
    required: list[str],
    definitions: Mapping[str, Schema] | None = None,
) -> Schema:
    """Return the schema of a whole file."""
    version: Schema = {
        "description": "Version of the language.",
        "enum": [FORMAT, str(FORMAT)],
        "default": FORMAT,
        "errorMessage": f"this version reads format: {FORMAT}",
    }
    whole = mapping({"format": version, **properties}, ["format", *required])
    shown = {"$schema": DRAFT, "title": title, "description": description, **whole}
    return {**shown, "definitions": dict(definitions)} if definitions else shown


def mapping(properties: Mapping[str, Schema], required: list[str]) -> Schema:
    """Return the schema of a mapping with these keys and no others."""
    schema: Schema = {
        "type": "object",
        "properties": {key: {"title": key, **one} for key, one in properties.items()},
        "additionalProperties": False,
    }
    return {**schema, "required": required} if required else schema


def listed(items: Schema) -> Schema:
    """Return the schema of a list."""
    return {"type": "array", "items": items}


def vector(space: SceneSpace) -> Schema:
    """Return the schema of values of all scene parameters."""
    return mapping(parameters(space), list(space.names))


def some_values(space: SceneSpace) -> Schema:
    """Return the schema of values of some scene parameters."""
    return mapping(parameters(space), [])


def script_schema(space: SceneSpace) -> Schema:
    """Return the schema of a script of visits."""
    person = described(value_schemas.boolean(), "Whether a person is there.")
    change = mapping(
        {
            "after": described(
                value_schemas.duration(), "Time since the start of the agent's run."
            ),
            "scene": described(some_values(space), "Scene parameters with their new values."),
            "person": person,
        },
        ["after"],
    )
    texts: Schema = {"type": "object", "additionalProperties": value_schemas.text()}
    visit = mapping(
        {
            "label": described(value_schemas.text(), "Who comes, in words."),
            "person": person,
            "urgent": described(
                value_schemas.boolean(),
                "Whether it may stop a running tree at once, where new scenes preempt.",
            ),
            "scene": described(some_values(space), "What is measured; the rest is missing."),
            "changes": described(listed(change), "What changes during the visit."),
            "answers": described(texts, "Words in a question → the person's answer."),
            "buttons": described(
                {**texts, "propertyNames": {"pattern": value_schemas.ros_name()["pattern"]}},
                "Topic of a button → words of the robot after which it is pressed.",
            ),
        },
        ["label"],
    )
    properties: dict[str, Schema] = {
        "title": described(value_schemas.text(), "Name for people."),
        "visits": described({**listed(visit), "minItems": 1}, "One after the other."),
    }
    return document("Script", "Visits, for the demo and for experiments.", properties, ["visits"])


def market_schema() -> Schema:
    """Return the schema of ``market.yaml``."""
    rule = mapping(
        {
            "when": described(value_schemas.condition(), "What has to hold, over scene.*."),
            "agents": described(
                {**listed(value_schemas.name()), "minItems": 1, "uniqueItems": True},
                "Who wins then: the first of them that bids.",
            ),
        },
        ["when", "agents"],
    )
    properties: dict[str, Schema] = {
        "rules": described(
            listed(rule), "For the strategy 'rules': the first one that holds counts."
        ),
    }
    return document("Market", "Rules by which the market chooses an agent.", properties, ["rules"])


def experiment_schema(space: SceneSpace) -> Schema:
    """Return the schema of an experiment."""
    opinion = {**some_values(space), "minProperties": 1}
    errors = mapping(
        {
            "every": described(value_schemas.integer(1), "Each so-manyth feedback is wrong."),
            "share": described(value_schemas.number(0, 1), "How likely a feedback is wrong."),
            "value": described(vector(space), "What is said then; any value when left out."),
        },
        [],
    )
    feedback = mapping(
        {
            "each": described(
                value_schemas.names(opinion), "Agent → the feedback that it always gets."
            ),
            "sequence": described(listed(opinion), "Feedback by round."),
            "repeat": described(
                value_schemas.boolean(), "Whether the sequence starts again at its end."
            ),
            "errors": described(
                {
                    **errors,
                    "oneOf": [
                        {"required": [key], "errorMessage": "write either 'every' or 'share'"}
                        for key in ("every", "share")
                    ],
                },
                "Which of the feedback is wrong.",
            ),
        },
        [],
    )
    properties: dict[str, Schema] = {
        "title": described(value_schemas.text(), "Name for people."),
        "rounds": described(value_schemas.integer(1), "How many rounds."),
        "seed": described(
            value_schemas.integer(0), "Makes the random numbers the same in every run."
        ),
        "scenes": described(
            {**listed(vector(space)), "minItems": 1}, "The scenes that are put on the market."
        ),
        "feedback": described(
            {
                **feedback,
                "anyOf": [
                    {"required": [key], "errorMessage": "write 'each' or 'sequence'"}
                    for key in ("each", "sequence")
                ],
            },
            "What the simulated person wants.",
        ),
    }
    return document(
        "Experiment",
        "Which scenes are put on the market, and what feedback follows.",
        properties,
        ["rounds", "seed", "scenes", "feedback"],
    )


def parameters(space: SceneSpace) -> dict[str, Schema]:
    """Return the schema of each scene parameter by name."""
    return {parameter.name: _parameter(parameter) for parameter in space.parameters}


def _parameter(parameter: SceneParameter) -> Schema:
    labels = ", ".join(f"{value:g} {word}" for value, word in parameter.labels.items())
    bounds = f"{parameter.minimum:g} to {parameter.maximum:g}"
    words = f"{parameter.description or parameter.name} ({bounds})"
    schema = value_schemas.number(parameter.minimum, parameter.maximum)
    return {
        **described(schema, f"{words}: {labels}" if labels else words),
        "defaultSnippets": [{"label": parameter.name, "body": f"${{1:{parameter.default:g}}}"}],
    }
