# SPDX-License-Identifier: Apache-2.0
"""Learning in agent files: ``learning``, ``weights`` and mood rules."""

from __future__ import annotations

from typing import Any

import pytest

from agent_texts import agent_of, problems_of
from bt_agents_core.feedback import LearningRule, Share, Update
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.model.mood_rule import ACTIONS, MoodAction
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.tools.schema.folder import schema_of
from tree_harness import SYMBOLS

TREE = "tree: {wait: 1 s}\n"


def read(text: str) -> AgentSpec:
    return agent_of(TREE + text)


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        ("", 0.2),
        ("learning_rate: 0.5\n", 0.5),
        ("learning: {rate: 0.5}\n", 0.5),
        ("learning_rate: 0\nlearning: {update: median}\n", 0.0),
    ],
)
def test_learning_rate_has_short_and_long_form(text, rate):
    assert read(text).learning_rate == rate


def test_agent_without_learning_uses_paper_rule():
    assert (read("").learning, read("").weights) == (LearningRule(), {})


def test_learning_accepts_all_its_keys():
    spec = read(
        """\
learning:
  rate: 0.3
  rates: {age: 0.1}
  freeze: [mood]
  update: median
  window: 9
  anneal: 0.01
  drift: {age: 1, mood: 0.5}
  retreat: {age: 1.5}
  weights: {button: 2, mood rule: 0.25, 1: 0}
  layers: [person, place, person]
  general: 0.4
  share: place
weights: {age: 2, mood: 0}
"""
    )
    assert spec.learning_rate == 0.3
    assert spec.learning == LearningRule(
        rates={"age": 0.1, "mood": 0.0},
        update=Update.MEDIAN,
        window=9,
        anneal=0.01,
        drift={"age": 1.0, "mood": 0.5},
        retreat={"age": 1.5},
        weights={"button": 2.0, "mood rule": 0.25, "1": 0.0},
        layers=("person", "place"),
        general=0.4,
        share=Share.PLACE,
    )
    assert spec.weights == {"age": 2.0, "mood": 0.0}


def test_width_requires_huber():
    rule = read("learning: {update: huber, width: {age: 0.5}}\n").learning
    assert (rule.update, rule.width) == (Update.HUBER, {"age": 0.5})


def test_freeze_all_stops_all_learning():
    rule = read("learning: {freeze: all}\n").learning
    assert rule.rates == {"age": 0.0, "familiarity": 0.0, "mood": 0.0}


IDLE = "has nothing to act on here"
ENDS = "the rule ends the run"


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        (
            "rates: {age: 1}, freeze: [age]",
            "5:29 contradiction: 'rates' says how fast age learns, 'freeze' that it does not",
        ),
        ("update: plain, window: 3", f"5:27 misplaced-key: 'window' {IDLE}"),
        ("update: median, width: {age: 1}", f"5:28 misplaced-key: 'width' {IDLE}"),
        (
            "update: huber, width: {age: 0}",
            "5:27 out-of-range: 'width' of age is 0, expected more",
        ),
        ("general: 0.5", f"5:12 misplaced-key: 'general' {IDLE}"),
        (
            "update: medium, window: 3",
            "5:20 bad-choice: 'update' is 'medium', expected plain, huber or median",
        ),
        ("update: median, window: 101", "5:36 out-of-range: 'window' is 101, expected 1 to 100"),
        ("rates: {age: 1.5}", "5:25 out-of-range: 'rates' of age is 1.5, expected 0 to 1"),
        ("drift: {age: 4.5}", "5:25 out-of-range: 'drift' of age is 4.5, expected 0 to 4"),
        ("drift: {agge: 1}", "5:20 unknown-name: there is no scene parameter 'agge'"),
        (
            "freeze: age",
            "5:20 wrong-type: 'freeze': expected a list of parameters, or 'all', found 'age'",
        ),
        ("freeze: [age, stress]", "5:26 unknown-name: there is no scene parameter 'stress'"),
        (
            "weights: {button: -1}",
            "5:30 out-of-range: the weight of 'button' is -1, expected 0 to 100",
        ),
        ("layers: [persons]", "5:21 bad-choice: a layer is 'persons', expected person or place"),
    ],
)
def test_mistake_in_learning_is_one_positioned_error(keys, problem):
    assert told(f"learning: {{{keys}}}\n") == [problem]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "learning_rate: 0.1\nlearning: {rate: 0.2}\n",
            "6:12 contradiction: 'learning_rate' says the learning rate, too",
        ),
        ("weights: {age: -1}\n", "5:16 out-of-range: 'weights' of age is -1, expected 0 to 100"),
        (
            "weights: 2\n",
            "5:10 wrong-type: 'weights': expected a mapping of numbers for age, familiarity, "
            "mood, found '2'",
        ),
        (
            "feedback: [{when: live.age >= 4, give: negative, baseline: 3 s}]\n",
            f"5:50 misplaced-key: 'baseline' {IDLE}: the rule does not look at mood.change",
        ),
    ],
)
def test_mistake_beside_learning_is_one_positioned_error(text, problem):
    assert told(text) == [problem]


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ("then: cancel, cooldown: 3 s", f"5:66 misplaced-key: 'cooldown' {IDLE}: {ENDS}"),
        ("confidence: 2", "5:64 out-of-range: 'confidence' is 2, expected 0 to 1"),
        ("release: live.mod > 1", "5:61 unknown-name: there is no name 'live.mod' here"),
    ],
)
def test_mistake_in_mood_rule_is_one_positioned_error(keys, problem):
    assert told(f"feedback: [{{when: mood.change > 1, give: positive, {keys}}}]\n") == [problem]


def told(text: str) -> list[str]:
    """Return 'line:column code: message' of every error of an agent."""
    return [
        f"{one.position.line}:{one.position.column} {one.code}: {one.message}"
        for one in problems_of(read, text)
    ]


def test_mood_rule_accepts_all_its_keys():
    (rule,) = read(
        """\
feedback:
  - when: mood.change <= -1
    for: 2 s
    give: negative
    baseline: 3 s
    release: mood.change > -0.5
    cooldown: 1 min
    confidence: 0.6
"""
    ).rules
    assert (rule.hold_s, rule.baseline_s, rule.cooldown_s) == (2.0, 3.0, 60.0)
    assert (rule.release.text, rule.confidence) == ("mood.change > -0.5", 0.6)


def test_minimal_mood_rule_fires_once_against_awarded_scene():
    (rule,) = read("feedback: [{when: mood.change > 1, give: positive}]\n").rules
    assert (rule.baseline_s, rule.release, rule.cooldown_s, rule.confidence) == (0, None, 0, 0)


def test_every_mood_action_except_none_has_keyword():
    assert {action for action, _ in ACTIONS.values()} == {*MoodAction} - {MoodAction.NONE}
    rule: Any = schema_of(AGENT, SYMBOLS)["properties"]["feedback"]["items"]
    assert rule["properties"]["then"]["enum"] == list(ACTIONS)
