# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of agent files and libraries: the files that hold trees and skills."""

from __future__ import annotations

from bt_agents_core.scene import MAX_WEIGHT, SceneSpace
from bt_agents_language.files.bindings import RECEIVED, SENT
from bt_agents_language.model.server_timeouts import timeout_keys
from bt_agents_language.model.specs import BindingKind, FieldType
from bt_agents_language.model.symbols import SymbolTable
from bt_agents_language.tools.schema import value_schemas
from bt_agents_language.tools.schema.documents import document, listed, mapping, vector
from bt_agents_language.tools.schema.learning_schema import by_parameter, learning, mood_rule
from bt_agents_language.tools.schema.node_schemas import NODE, node_definitions
from bt_agents_language.tools.schema.servers import heartbeat, timeouts
from bt_agents_language.tools.schema.value_schemas import Schema, described

_TYPES = [one.value for one in FieldType]


def agent_schema(vocabulary: SymbolTable) -> Schema:
    """Return the schema of an agent file."""
    space = vocabulary.space
    conditions = f"Names: {', '.join(_condition_names(space))}."
    properties: dict[str, Schema] = {
        "agent": described(value_schemas.name(), "Unique name of the agent."),
        "title": described(value_schemas.text(), "Name for people."),
        "description": described(value_schemas.text(), "What it does and whom it suits."),
        "tags": described(listed(value_schemas.text()), "Words to find it by."),
        "imports": _imports(),
        "profile": described(
            vector(space), "The scene that it suits best: its bid. Feedback moves it."
        ),
        "learning_rate": described(
            value_schemas.number(0, 1),
            "How far one feedback moves the profile, 0 to 1; or 'learning'.",
        ),
        "learning": described(learning(space), "How feedback moves the profile."),
        "weights": described(
            by_parameter(space, lambda _: (0, MAX_WEIGHT)),
            "How much parameters count for it where distances are weighted; 1 is usual.",
        ),
        "requires": described(
            value_schemas.condition(),
            "It does not bid unless this is true of the scene: scene.person",
        ),
        "tunables": described(
            value_schemas.names(_tunable()),
            "Values that may change while the tree runs; each is a ROS parameter and a slider.",
        ),
        "feedback": described(
            listed(mood_rule(conditions)),
            "What a change of mood during the run teaches the agent.",
        ),
        "tree": described(dict(NODE), "What the agent does."),
        "on_cancel": described(dict(NODE), "Clean-up after a run was stopped, bounded in time."),
        "subtrees": _subtrees(),
    }
    return document(
        "Agent",
        "An interaction character: its profile and its behaviour tree.",
        properties,
        ["agent", "profile", "tree"],
        node_definitions(vocabulary),
    )


def library_schema(vocabulary: SymbolTable) -> Schema:
    """Return the schema of a skills file or library."""
    properties: dict[str, Schema] = {
        "description": described(value_schemas.text(), "What the library is for."),
        "robot": described(value_schemas.text(), "The robot that its bindings are for."),
        "imports": _imports(),
        "skills": described(
            value_schemas.names(_skill()), "What the robot can do, in authors' words."
        ),
        "bindings": described(
            value_schemas.names(_bound({})),
            "How the robot does skills that other files declare: skill → ROS interface.",
        ),
        "subtrees": _subtrees(),
    }
    return document(
        "Library",
        "Skills, their bindings to a robot, and subtrees that agents share.",
        properties,
        [],
        node_definitions(vocabulary),
    )


def _condition_names(space: SceneSpace) -> list[str]:
    names = [f"{group}.{name}" for group in ("scene", "live") for name in space.names]
    mood = ["mood.change"] if space.mood else []
    return [*names, "scene.person", "live.person", "live.stale", *mood]


def _imports() -> Schema:
    return described(
        listed(value_schemas.text()),
        "Libraries, by their paths from the trees folder: libraries/x.yaml",
    )


def _tunable() -> Schema:
    amount: Schema = {"type": ["number", "string"]}
    return mapping(
        {
            "default": described(
                value_schemas.text(),
                "Its value at the start; says the type: 2, 2.0, 8 s, true, a text.",
            ),
            "min": described(dict(amount), "Smallest value."),
            "max": described(dict(amount), "Largest value."),
            "step": described(dict(amount), "Distance of the allowed values from 'min' on."),
            "description": described(value_schemas.text(), "What it changes, in words."),
        },
        ["default"],
    )


def _subtrees() -> Schema:
    subtree = mapping(
        {
            "description": described(value_schemas.text(), "What it does."),
            "inputs": described(
                value_schemas.names(_input()), "What its callers give with 'with'."
            ),
            "outputs": described(
                value_schemas.names(_output()),
                "Names that it writes for its callers, with their types.",
            ),
            "tree": described(dict(NODE), "What it does."),
        },
        ["tree"],
    )
    # The name of a subtree may be written as those of nodes, which the reader judges.
    return described(
        {"type": "object", "additionalProperties": subtree}, "Trees that 'subtree' nodes do."
    )


def _input() -> Schema:
    declared = mapping(
        {
            "type": {"description": "Its type.", "enum": _TYPES},
            "default": {"description": "Taken when it is not given."},
            "description": described(value_schemas.text(), "What it means."),
        },
        ["type"],
    )
    return {"anyOf": [{"enum": _TYPES}, declared]}


def _output() -> Schema:
    declared = mapping(
        {
            "type": {"description": "Its type.", "enum": _TYPES},
            "description": described(value_schemas.text(), "What it means."),
        },
        [],
    )
    return {"anyOf": [{"enum": _TYPES}, declared]}


def _skill() -> Schema:
    result = mapping(
        {
            "type": {"description": "Its type.", "enum": _TYPES},
            "from": described(
                value_schemas.text(),
                "Field of the result, or feedback.x; its own name if left out.",
            ),
            "description": described(value_schemas.text(), "What it means."),
        },
        [],
    )
    output: Schema = {"anyOf": [{"enum": _TYPES}, result, {"type": "null"}]}
    return _bound(
        {
            "description": described(value_schemas.text(), "What it does, for authors."),
            "main": described(
                value_schemas.text(), "The input that a scalar behind it stands for."
            ),
            "inputs": described(value_schemas.names(_input()), "Its inputs and their types."),
            "outputs": described(value_schemas.names(output), "Names that later nodes may use."),
        }
    )


def _bound(declared: dict[str, Schema]) -> Schema:
    """Return the schema of a skill or binding: at most one ROS interface."""
    outputs = described(
        value_schemas.names(value_schemas.text()),
        "Output → field of what comes back, feedback.x of feedback.",
    )
    properties = {
        **({} if "outputs" in declared else {"outputs": outputs}),
        **declared,
        "action": described(_interface(BindingKind.ACTION), "The ROS action that does it."),
        "service": described(_interface(BindingKind.SERVICE), "The ROS service that does it."),
        "topic": described(_interface(BindingKind.TOPIC), "The ROS topic that does it."),
    }
    return mapping(properties, [])


def _interface(kind: BindingKind) -> Schema:
    sent = SENT[kind]
    properties: dict[str, Schema] = {
        "name": described(
            value_schemas.ros_name(), "Its ROS name, relative unless it starts with '/'."
        ),
        "type": described(value_schemas.ros_type(), "Its ROS type, package/kind/Name."),
        sent: described(
            {"type": "object"}, f"Fields of the {sent}; ${{input}} fills an input in."
        ),
    }
    if kind in RECEIVED:
        properties["succeed_when"] = described(
            value_schemas.condition(),
            "Condition over result.*; without it, an answer is a success.",
        )
        properties["timeouts"] = described(
            timeouts(timeout_keys(kind)), "How long the server may take; then the node fails."
        )
        properties["heartbeat"] = described(
            heartbeat(), "What the server publishes while it is alive; its death is noticed by it."
        )
    return mapping(properties, ["name", "type"])
