# SPDX-License-Identifier: Apache-2.0
"""Mood rules of an agent, read from ``feedback:`` or restored from its card."""

from __future__ import annotations

import math

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import ValueKind
from bt_agents_language.expression.expressions import Expression, parse_expression
from bt_agents_language.expression.ranges import FALSE, Range
from bt_agents_language.fields.scope import (
    NameScope,
    mood_names,
    scene_labels,
    scene_names,
    scene_scope,
)
from bt_agents_language.fields.values import read_condition
from bt_agents_language.model.mood_rule import ACTIONS, MoodAction, MoodRule
from bt_agents_language.yaml.field_tables import (
    DURATION,
    SHARE,
    FieldDecl,
    Form,
    KeyTable,
    Single,
    WordChoice,
)
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Node

_GIVES = {kind.name.lower(): kind for kind in (FeedbackKind.POSITIVE, FeedbackKind.NEGATIVE)}

MOOD_RULE = KeyTable(
    what="a feedback rule",
    fields=(
        FieldDecl(
            "when", Single(Form.CONDITION, scene_names=True), "What must be true.", required=True
        ),
        FieldDecl("for", DURATION, "How long the condition must hold without interruption."),
        FieldDecl(
            "give",
            WordChoice(tuple(_GIVES)),
            "positive: the profile moves towards the scene; negative: away from it.",
            required=True,
        ),
        FieldDecl(
            "then",
            WordChoice(tuple(ACTIONS)),
            "; ".join(f"{word}: {text}" for word, (_, text) in ACTIONS.items()) + ".",
        ),
        FieldDecl(
            "baseline",
            DURATION,
            "mood.change compares the mood with its mean over this time at the start of the run.",
        ),
        FieldDecl(
            "release",
            Single(Form.CONDITION, scene_names=True),
            "Condition that makes a rule that has fired ready again.",
        ),
        FieldDecl(
            "cooldown", DURATION, "Shortest time until a rule that has fired is ready again."
        ),
        FieldDecl("confidence", SHARE, "A mood with a lower confidence counts as unknown."),
    ),
)

_CHANGE = "mood.change"
_UNNOTICED = 1e-6


def read_mood_rules(
    reading: TypedReader, agent: MappingReader, space: SceneSpace
) -> tuple[MoodRule, ...]:
    """Return the mood rules of an agent file; report problems."""
    return readable(_rule(reading, node, space) for node in agent.items("feedback"))


def _rule(reading: TypedReader, node: Node, space: SceneSpace) -> MoodRule | None:
    fields = reading.keys(node, MOOD_RULE)
    if fields is None:
        return None
    when = _condition(reading, fields, "when", space)
    release = _condition(reading, fields, "release", space)
    hold_s = fields.duration("for")
    baseline_s = fields.duration("baseline")
    cooldown_s = fields.duration("cooldown")
    confidence = fields.number("confidence")
    give = fields.choice("give")
    then = fields.choice("then")
    action = MoodAction.NONE if then is None else ACTIONS[then][0]
    if action.ends_run:
        for key in ("release", "cooldown"):
            if fields.get(key) is not None:
                reading.error(
                    "misplaced-key",
                    fields.keys[key],
                    f"'{key}' has nothing to act on here: the rule ends the run",
                    f"take out '{key}', or 'then: {then}'",
                )
    if when is None or give is None:
        return None
    if "for" not in fields.keys and _fires_at_once(when, space):
        reading.warning(
            "hasty-rule",
            fields.nodes["when"],
            "this fires at the smallest change of the mood, even where it is only measured anew",
            "add 'for: 2 s', or ask for more, such as mood.change >= 0.5",
        )
    named = when.names | (release.names if release is not None else frozenset())
    if baseline_s and _CHANGE not in named:
        reading.error(
            "misplaced-key",
            fields.keys["baseline"],
            f"'baseline' has nothing to act on here: the rule does not look at {_CHANGE}",
            f"take out 'baseline', or ask for {_CHANGE}",
        )
    return MoodRule(
        when=when,
        hold_s=hold_s or 0.0,
        give=_GIVES[give],
        action=action,
        baseline_s=baseline_s or 0.0,
        release=release,
        cooldown_s=cooldown_s or 0.0,
        confidence=confidence or 0.0,
    )


def _condition(
    reading: TypedReader, fields: MappingReader, key: str, space: SceneSpace
) -> Expression | None:
    return fields.read(key, lambda node, what: read_condition(reading, node, _names(space), what))


def _fires_at_once(when: Expression, space: SceneSpace) -> bool:
    """Return whether an unnoticeable change of the mood can make a condition true."""
    if _CHANGE not in when.names:
        return False
    hardly = {_CHANGE: Range(-_UNNOTICED, _UNNOTICED)}
    labels = scene_labels(space)
    read = parse_expression(when.text, range_of=hardly.get, labels_of=labels.get)
    refused = sum(not one.always and _CHANGE in one.names for one in read.foregone)
    asked = sum(mention.name == _CHANGE for mention in when.mentions)
    return read.range != FALSE and refused < asked


def _names(space: SceneSpace) -> NameScope:
    # For suggestions of names, values that change during a run come first.
    return scene_scope(space, {**scene_names(space, ("live", "scene")), **mood_names(space)})


def restore_mood_rule(
    space: SceneSpace,
    *,
    when: str,
    hold_s: float = 0.0,
    give: int,
    action: int = MoodAction.NONE,
    baseline_s: float = 0.0,
    release: str = "",
    cooldown_s: float = 0.0,
    confidence: float = 0.0,
) -> MoodRule:
    """Return a mood rule from the values of ``MoodRule.msg``; refuse others with ``BAD_RULE``."""
    for seconds, text in (
        (hold_s, "held"),
        (baseline_s, "a baseline of"),
        (cooldown_s, "a cooldown of"),
    ):
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise _bad_rule(when, f"{text} {seconds} s, expected 0 s or more")
    if not 0.0 <= confidence <= 1.0:
        raise _bad_rule(when, f"confidence {confidence}, expected 0 to 1")
    if give not in _GIVES.values():
        raise _bad_rule(when, f"gives {give}, expected 1 or 2")
    if action not in set(MoodAction):
        raise _bad_rule(when, f"action {action}, expected 0 to {max(MoodAction)}")
    return MoodRule(
        when=_restored_condition(when, when, space),
        hold_s=hold_s,
        give=FeedbackKind(give),
        action=MoodAction(action),
        baseline_s=baseline_s,
        release=_restored_condition(release, when, space) if release else None,
        cooldown_s=cooldown_s,
        confidence=confidence,
    )


def _restored_condition(text: str, rule: str, space: SceneSpace) -> Expression:
    names = _names(space)
    try:
        condition = names.parse(text)
    except ExpressionError as error:
        raise _bad_rule(rule, str(error)) from None
    for name in sorted(condition.names):
        if names.type_of(name) is None:
            known = ", ".join(sorted({**scene_names(space), **mood_names(space)}))
            raise _bad_rule(rule, f"there is no name '{name}' here; it may name {known}")
    if condition.kind not in (None, ValueKind.BOOLEAN):
        raise _bad_rule(rule, f"'{text}' is not a condition; compare, as in 'live.mood < 2'")
    return condition


def _bad_rule(rule: str, problem: str) -> Refused:
    return Refused(RefusalCode.BAD_RULE, f"rule '{rule}': {problem}")
