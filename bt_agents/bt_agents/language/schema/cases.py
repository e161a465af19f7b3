# SPDX-License-Identifier: Apache-2.0
"""JSON Schema of test files: rehearsals of an agent, and what is expected of them."""

from __future__ import annotations

from bt_agents.feedback import Kind
from bt_agents.language.schema import values
from bt_agents.language.schema.scenes import document, listed, mapping, parameters, some_values
from bt_agents.language.schema.values import Schema, described
from bt_agents.language.testing.scenarios import GoalEnd
from bt_agents.language.testing.test_reader import OUTCOMES
from bt_agents.language.vocabulary import Vocabulary

_ENDS = [end.value for end in (GoalEnd.REJECTED, GoalEnd.UNREACHABLE, GoalEnd.NEVER)]


def cases_schema(vocabulary: Vocabulary) -> Schema:
    """Return the schema of a test file."""
    space = vocabulary.space
    person = described(values.boolean(), "Whether a person is there.")
    scene = some_values(space)
    if "person" not in space.names:
        scene = mapping({**parameters(space), "person": person}, [])
    tunables = values.names({})
    case = mapping(
        {
            "name": described(values.text(), "What is special about this case."),
            "scene": described(scene, "The scene as awarded; the rest is missing."),
            "person": person,
            "tunables": described(tunables, "Values that differ from the defaults."),
            "seed": described(values.integer(0), "Makes everything random the same each time."),
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
        "test": described(values.text(), "The agent: its name, or its file beside this one."),
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
            "fails": described(values.text(), "It fails, for this reason."),
            "ends": {"description": "How else it ends.", "enum": _ENDS},
            "after": described(values.duration(), "How long it takes."),
        },
        [],
    )
    one: Schema = {"anyOf": [values.text(), answer]}
    return {"type": "object", "additionalProperties": _several(one)}


def _happening(vocabulary: Vocabulary) -> Schema:
    message = mapping(
        {
            "topic": described(values.ros_name(), "Where the message arrives."),
            "message": described({"type": "object"}, "Its fields."),
        },
        ["topic"],
    )
    own: dict[str, Schema] = {
        "after": described(values.duration(), "Time since the start of the run, or of 'at'."),
        "at": described(values.text(), "Path of the node from whose start on 'after' counts."),
        "person": described(values.boolean(), "Whether the person is there from now on."),
        "scene_layer": {
            "description": "Silent: from now on nothing new is known of the scene.",
            "enum": ["silent", "back"],
        },
        "publish": described(message, "A message arrives."),
        "tune": described(values.names({}), "Tunable → new value."),
        "cancel": described(values.text(), "The run is cancelled, for this reason."),
    }
    return mapping({**parameters(vocabulary.space), **own}, [])


def _expectations() -> Schema:
    use: Schema = {
        "anyOf": [
            values.text(),
            {"type": "object", "minProperties": 1, "maxProperties": 1},
        ]
    }
    paths = _several(values.text())
    kinds: Schema = {"enum": [kind.name.lower() for kind in Kind]}
    expectations = mapping(
        {
            "bids": described(values.boolean(), "Whether it bids for the scene at all."),
            "says": described(
                _texts_or_contained(values.text()), "What it says, in order and nothing else."
            ),
            "does": described(
                _texts_or_contained(use), "The skills it uses, in order and nothing else."
            ),
            "does_not": described(_several(use), "Skills that it does not use."),
            "visited": described(paths, "Paths of nodes that are ticked."),
            "not_visited": described(paths, "Paths of nodes that are never ticked."),
            "ends": {"description": "How the run ends.", "enum": list(OUTCOMES)},
            "because": described(values.text(), "Words of the reason why it ended."),
            "within": described(values.duration(), "The longest time that it may take."),
            "feedback": described(_several(kinds), "The feedback that is given, in order."),
            "cancelled_by": described(
                values.text(), "The condition of the mood rule, or the reason, that cancels it."
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
