# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of how an agent learns: its rates, its robustness and its mood rules."""

from __future__ import annotations

from collections.abc import Callable

from bt_agents_core.feedback import Update
from bt_agents_core.scene import MAX_WEIGHT, SceneParameter, SceneSpace
from bt_agents_language.files.learning_reader import LAYERS, MAX_WINDOW
from bt_agents_language.tools.schema import value_schemas
from bt_agents_language.tools.schema.documents import listed, mapping
from bt_agents_language.tools.schema.value_schemas import Schema, described

Limits = Callable[[SceneParameter], tuple[float, float]]


def by_parameter(space: SceneSpace, limits: Limits) -> Schema:
    """Return the schema of numbers for some scene parameters."""
    return mapping({p.name: value_schemas.number(*limits(p)) for p in space.parameters}, [])


def learning(space: SceneSpace) -> Schema:
    """Return the schema of ``learning``."""

    def up_to_range(parameter: SceneParameter) -> tuple[float, float]:
        return 0, parameter.maximum - parameter.minimum

    parameters: Schema = {"enum": list(space.names)}
    return mapping(
        {
            "rate": described(
                value_schemas.number(0, 1),
                "How far one feedback moves the profile; as 'learning_rate'.",
            ),
            "rates": described(
                by_parameter(space, lambda _: (0, 1)), "The same for single parameters."
            ),
            "freeze": described(
                {"anyOf": [{"const": "all"}, listed(parameters)]},
                "Parameters that do not learn, or 'all'.",
            ),
            "update": {
                "description": "plain: every feedback counts fully; huber: one that is far away "
                "counts as if it were nearer; median: what most of the last ones want.",
                "enum": [one.value for one in Update],
            },
            "width": described(
                by_parameter(space, up_to_range),
                "Of huber: no feedback counts as if it were farther than this.",
            ),
            "window": described(
                value_schemas.integer(1) | {"maximum": MAX_WINDOW},
                "Of median: so many of the last feedbacks count.",
            ),
            "anneal": described(
                value_schemas.number(0, 100),
                "After n feedbacks the rate is rate / (1 + anneal × n).",
            ),
            "drift": described(
                by_parameter(space, up_to_range), "Farthest that the profile gets from this file."
            ),
            "weights": described(
                {"type": "object", "additionalProperties": value_schemas.number(0, MAX_WEIGHT)},
                "How much sources of feedback count: button, mood rule, ….",
            ),
            "layers": described(
                listed({"enum": list(LAYERS)}), "What it learns apart for each person or place."
            ),
            "general": described(
                value_schemas.number(0, 1),
                "How much of what it learns for a person or place counts for everybody.",
            ),
        },
        [],
    )


def mood_rule(conditions: str) -> Schema:
    """Return the schema of an entry of ``feedback``.

    Args:
        conditions: The names that its conditions may use, in words.
    """
    return mapping(
        {
            "when": described(value_schemas.condition(), f"What must be true. {conditions}"),
            "for": described(value_schemas.duration(), "How long it must hold without a break."),
            "give": {
                "description": "positive: the profile moves towards the scene; negative: away.",
                "enum": ["positive", "negative"],
            },
            "then": {
                "description": "cancel: stop the run and let the market ask again.",
                "enum": ["cancel"],
            },
            "baseline": described(
                value_schemas.duration(),
                "mood.change is against the mean mood of so long at the start of the run.",
            ),
            "release": described(
                value_schemas.condition(),
                f"What makes a rule that has fired ready again. {conditions}",
            ),
            "cooldown": described(
                value_schemas.duration(), "A rule that has fired is ready again after so long."
            ),
            "confidence": described(
                value_schemas.number(0, 1), "A mood of which the source is less sure is not known."
            ),
        },
        ["when", "give"],
    )
