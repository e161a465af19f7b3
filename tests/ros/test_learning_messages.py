# SPDX-License-Identifier: Apache-2.0
"""Learning settings on their way from an agent's file to the feedback node."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents.host.host_card import learning_to_msg, rule_to_msg
from bt_agents_core.feedback import WEIGHTS, LearningRule, Update
from bt_agents_interfaces.msg import AgentCard, HostCard
from bt_agents_interfaces.msg import MoodRule as MoodRuleMsg
from bt_agents_language.model.mood_rule import MoodAction
from feedback_node.learning.cards import read_card
from feedback_node.node.messages import card_from_msg, rule_from_msg
from tree_harness import SPACE, agent

RULES = """\
feedback:
  - {when: mood.change >= 0.5, give: positive}
  - when: mood.change <= -1
    for: 2 s
    give: negative
    baseline: 3 s
    release: mood.change > 0
    cooldown: 5 s
    confidence: 0.5
"""


@pytest.mark.parametrize(
    "rule",
    [
        LearningRule(),
        LearningRule(
            rates={"age": 0.1, "mood": 0.0},
            update=Update.HUBER,
            width={"mood": 0.5},
            window=7,
            anneal=0.5,
            drift={"familiarity": 1.0},
            retreat={"age": 2.0},
            weights={"button": 2.0, "a program": 0.0},
            layers=("place",),
            general=0.25,
        ),
    ],
)
def test_learning_rule_survives_message_conversion(rule):
    spec = agent("  wait: 1 s", head=RULES)
    card = AgentCard(
        name="a",
        profile=[3.0, 3.0, 3.0],
        learning_rate=0.2,
        learning=learning_to_msg(rule, SPACE),
        rules=[rule_to_msg(one) for one in spec.rules],
    )
    message = HostCard(host="/agents", parameters=SPACE.names, agents=[card])
    (known,), problems = read_card(card_from_msg(message, SPACE), SPACE)
    assert problems == ()
    assert known.learning == replace(rule, weights={**WEIGHTS, **rule.weights})
    assert known.entry.rules == spec.rules


def test_process_parses_each_condition_once():
    spec = agent("  wait: 1 s", head=RULES)
    for rule in spec.rules:
        restored = rule_from_msg(rule_to_msg(rule), SPACE)
        assert restored == rule
        assert restored.when is rule.when
        assert restored.release is rule.release


@pytest.mark.parametrize("action", MoodAction)
def test_mood_rule_actions_match_message_constants(action):
    assert getattr(MoodRuleMsg, action.name) == action
    rule = replace(agent("  wait: 1 s", head=RULES).rules[0], action=action)
    assert rule_from_msg(rule_to_msg(rule), SPACE) == rule
