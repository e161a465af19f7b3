# SPDX-License-Identifier: Apache-2.0
"""Reads the mood rules of an agent: the entries of ``feedback:``."""

from __future__ import annotations

from bt_agents_core.scene import SceneSpace
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.scope import NameScope, mood_names, scene_names
from bt_agents_language.model.specs import FeedbackRule
from bt_agents_language.model.values import read_condition
from bt_agents_language.yaml.mapping_reader import MappingReader
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Node

KEYS = ("when", "for", "give", "then", "baseline", "release", "cooldown", "confidence")

_CHANGE = "mood.change"
_AGAIN = ("release", "cooldown")


def read_mood_rules(
    reading: TypedReader, agent: MappingReader, space: SceneSpace
) -> tuple[FeedbackRule, ...]:
    """Return the mood rules of an agent file; problems are reported."""
    rules = (_rule(reading, node, space) for node in agent.items("feedback"))
    return tuple(rule for rule in rules if rule is not None)


def _rule(reading: TypedReader, node: Node, space: SceneSpace) -> FeedbackRule | None:
    fields = reading.fields(node, "a feedback rule", KEYS, ("when", "give"))
    if fields is None:
        return None
    when = _condition(reading, fields, "when", space)
    release = _condition(reading, fields, "release", space)
    hold_s = fields.duration("for")
    baseline_s = fields.duration("baseline")
    cooldown_s = fields.duration("cooldown")
    confidence = fields.number("confidence", 0.0, 1.0)
    give = fields.choice("give", ("positive", "negative"))
    then = fields.choice("then", ("cancel",))
    if then == "cancel":
        for key in _AGAIN:
            if fields.get(key) is not None:
                reading.error(
                    "misplaced-key",
                    fields.keys[key],
                    f"'{key}' has nothing to act on here: the rule ends the run",
                    f"take out '{key}', or 'then: cancel'",
                )
    if when is None or give is None:
        return None
    named = when.names | (release.names if release is not None else frozenset())
    if baseline_s and _CHANGE not in named:
        reading.error(
            "misplaced-key",
            fields.keys["baseline"],
            f"'baseline' has nothing to act on here: the rule does not look at {_CHANGE}",
            f"take out 'baseline', or ask for {_CHANGE}",
        )
    return FeedbackRule(
        when=when,
        hold_s=hold_s or 0.0,
        positive=give == "positive",
        cancel=then == "cancel",
        position=node.position,
        baseline_s=baseline_s or 0.0,
        release=release,
        cooldown_s=cooldown_s or 0.0,
        confidence=confidence or 0.0,
    )


def _condition(
    reading: TypedReader, fields: MappingReader, key: str, space: SceneSpace
) -> Expression | None:
    node = fields.get(key)
    names = NameScope({**scene_names(space), **mood_names(space)})
    return None if node is None else read_condition(reading, node, names, f"'{key}'")
