# SPDX-License-Identifier: Apache-2.0
"""JSON Schema of test files: rehearsals of an agent, and what is expected of them."""

from __future__ import annotations

from bt_agents_core.feedback import FeedbackKind
from bt_agents_language.files.testing.scenarios import GoalEnd
from bt_agents_language.files.testing.test_reader import OUTCOMES
from bt_agents_language.model.symbols import SymbolTable
from bt_agents_language.tools.schema import value_schemas
from bt_agents_language.tools.schema.documents import (
    document,
    listed,
    mapping,
    parameters,
    some_values,
)
from bt_agents_language.tools.schema.value_schemas import Schema, described

_ENDS = [end.value for end in (GoalEnd.REJECTED, GoalEnd.UNREACHABLE, GoalEnd.NEVER)]


def cases_schema(vocabulary: SymbolTable) -> Schema:
    """Return the schema of a test file."""
    space = vocabulary.space
    person = described(value_schemas.boolean(), "Whether a person is there.")
    scene = some_values(space)
    if "person" not in space.names:
        scene = mapping({**parameters(space), "person": person}, [])
    tunables = value_schemas.names({})
    case = mapping(
        {
            "name": described(value_schemas.text(), "What is special about this case."),
            "scene": described(scene, "The scene as awarded; the rest is missing."),
            "person": person,
            "tunables": described(tunables, "Values that differ from the defaults."),
            "seed": described(
                value_schemas.integer(0), "Makes everything random the same each time."
            ),
            "answers": described(_answers(), "Skill or path of a node → how the world answers."),
            "replace": described(
                {
                    "type": "object",
                    "additionalProperties": {
                        "anyOf": [{"enum": ["succeed", "fail"]}, {"type": "object"}]
                    },
                },
                "Path of a node → what stands in for it.",
            ),
            "during": described(listed(_happening(vocabulary)), "What happens during the run."),
            "expect": described(_expectations(), "What must come out."),
        },
        ["name", "expect"],
    )
    properties: dict[str, Schema] = {
        "test": described(
            value_schemas.text(), "The agent: its name, or its file beside this one."
        ),
        "cases": described({**listed(case), "minItems": 1}, "The cases, each a rehearsal."),
    }
    return document("Test", "Rehearsals of an agent.", properties, ["test", "cases"])


def _several(one: Schema, *others: Schema) -> Schema:
    return {"anyOf": [one, {"type": "array", "items": one}, *others]}


def _answers() -> Schema:
    answer = mapping(
        {
            "gives": {"description": "Value of the first output."},
            "outputs": described({"type": "object"}, "Output → value."),
            "fails": described(value_schemas.text(), "It fails, for this reason."),
            "ends": {"description": "How else it ends.", "enum": _ENDS},
            "after": described(value_schemas.duration(), "How long it takes."),
        },
        [],
    )
    one: Schema = {"anyOf": [value_schemas.text(), answer]}
    return {"type": "object", "additionalProperties": _several(one)}


def _happening(vocabulary: SymbolTable) -> Schema:
    message = mapping(
        {
            "topic": described(value_schemas.ros_name(), "Where the message arrives."),
            "message": described({"type": "object"}, "Its fields."),
        },
        ["topic"],
    )
    own: dict[str, Schema] = {
        "after": described(
            value_schemas.duration(), "Time since the start of the run, or of 'at'."
        ),
        "at": described(
            value_schemas.text(), "Path of the node from whose start on 'after' counts."
        ),
        "person": described(value_schemas.boolean(), "Whether the person is there from now on."),
        "scene_layer": {
            "description": "Silent: from now on nothing new is known of the scene.",
            "enum": ["silent", "back"],
        },
        "publish": described(message, "A message arrives."),
        "tune": described(value_schemas.names({}), "Tunable → new value."),
        "cancel": described(value_schemas.text(), "The run is cancelled, for this reason."),
    }
    return mapping({**parameters(vocabulary.space), **own}, [])


def _expectations() -> Schema:
    use: Schema = {
        "anyOf": [
            value_schemas.text(),
            {"type": "object", "minProperties": 1, "maxProperties": 1},
        ]
    }
    paths = _several(value_schemas.text())
    kinds: Schema = {"enum": [kind.name.lower() for kind in FeedbackKind]}
    expectations = mapping(
        {
            "bids": described(value_schemas.boolean(), "Whether it bids for the scene at all."),
            "says": described(
                _texts_or_contained(value_schemas.text()),
                "What it says, in order and nothing else.",
            ),
            "does": described(
                _texts_or_contained(use), "The skills it uses, in order and nothing else."
            ),
            "does_not": described(_several(use), "Skills that it does not use."),
            "visited": described(paths, "Paths of nodes that are ticked."),
            "not_visited": described(paths, "Paths of nodes that are never ticked."),
            "ends": {"description": "How the run ends.", "enum": list(OUTCOMES)},
            "because": described(value_schemas.text(), "Words of the reason why it ended."),
            "within": described(value_schemas.duration(), "The longest time that it may take."),
            "feedback": described(_several(kinds), "The feedback that is given, in order."),
            "cancelled_by": described(
                value_schemas.text(),
                "The condition of the mood rule, or the reason, that cancels it.",
            ),
        },
        [],
    )
    return {**expectations, "minProperties": 1}


def _texts_or_contained(one: Schema) -> Schema:
    """Return the schema of all items, or of some under ``contains``."""
    contained = mapping(
        {"contains": described(_several(one), "These, in order; others may come between.")},
        ["contains"],
    )
    return _several(one, contained)
