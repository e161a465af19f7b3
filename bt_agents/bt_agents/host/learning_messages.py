# SPDX-License-Identifier: Apache-2.0
"""How an agent learns, as messages: its learning rule and its mood rules."""

from __future__ import annotations

from bt_agents_core.feedback import WEIGHTS, LearningRule
from bt_agents_core.scene import SceneSpace
from bt_agents_interfaces.msg import Learning, MoodRule
from bt_agents_language.model.specs import FeedbackRule


def learning_to_msg(rule: LearningRule, space: SceneSpace) -> Learning:
    """Return the message of a learning rule, its values in the order of the space."""
    weights = {**WEIGHTS, **rule.weights}
    return Learning(
        rates=space.ordered(rule.rates),
        update=rule.update.value,
        width=space.ordered(rule.width),
        window=rule.window,
        anneal=rule.anneal,
        drift=space.ordered(rule.drift),
        sources=list(weights),
        weights=list(weights.values()),
        layers=list(rule.layers),
        general=rule.general,
    )


def rule_to_msg(rule: FeedbackRule) -> MoodRule:
    """Return the message of a mood rule."""
    return MoodRule(
        when=rule.when.text,
        hold_s=rule.hold_s,
        give=MoodRule.POSITIVE if rule.positive else MoodRule.NEGATIVE,
        baseline_s=rule.baseline_s,
        release=rule.release.text if rule.release is not None else "",
        cooldown_s=rule.cooldown_s,
        confidence=rule.confidence,
        cancel=rule.cancel,
    )
