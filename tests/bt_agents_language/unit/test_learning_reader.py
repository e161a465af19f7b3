# SPDX-License-Identifier: Apache-2.0
"""Learning in agent files: ``learning``, ``weights`` and mood rules."""

from __future__ import annotations

from typing import Any

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_core.feedback import LearningRule, Share, Update
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.model.mood_rule import ACTIONS, MoodAction
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.tools.schema.folder import schema_of
from file_texts import read_agent_text
from tree_harness import SYMBOLS

HEAD = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\ntree: {wait: 1 s}\n"
RULE = "feedback: [{{when: mood.change > 1, give: positive, {}}}]\n"


def read(text: str) -> AgentSpec:
    return read_agent_text(HEAD + text, "a.yaml", SYMBOLS)


def errors(text: str) -> list[str]:
    with pytest.raises(ReadError) as error:
        read(text)
    return [line.removeprefix("a.yaml:") for line in error.value.lines]


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        ("", 0.2),
        ("learning_rate: 0.5\n", 0.5),
        ("learning: {rate: 0.5}\n", 0.5),
        ("learning: {update: median}\n", 0.2),
        ("learning_rate: 0\nlearning: {update: median}\n", 0.0),
    ],
)
def test_learning_rate_has_short_and_long_form(text, rate):
    assert read(text).learning_rate == rate


def test_agent_without_learning_uses_paper_rule():
    assert read("").learning == LearningRule()
    assert read("").weights == {}


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


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            "learning_rate: 0.1\nlearning: {rate: 0.2}\n",
            "6:12: error[contradiction]: 'learning_rate' says the learning rate, too",
        ),
        (
            "learning: {rates: {age: 1}, freeze: [age]}\n",
            "5:29: error[contradiction]: 'rates' says how fast age learns, 'freeze' that it does "
            "not",
        ),
        (
            "learning: {update: plain, window: 3}\n",
            "5:27: error[misplaced-key]: 'window' has nothing to act on here",
        ),
        (
            "learning: {update: median, width: {age: 1}}\n",
            "5:28: error[misplaced-key]: 'width' has nothing to act on here",
        ),
        (
            "learning: {update: huber, width: {age: 0}}\n",
            "5:27: error[out-of-range]: 'width' of age is 0, expected more",
        ),
        (
            "learning: {general: 0.5}\n",
            "5:12: error[misplaced-key]: 'general' has nothing to act on here",
        ),
        (
            "learning: {share: all}\n",
            "5:19: error[bad-choice]: 'share' is 'all', expected everything, place or nothing",
        ),
        (
            "learning: {update: medium}\n",
            "5:20: error[bad-choice]: 'update' is 'medium', expected plain, huber or median",
        ),
        (
            "learning: {update: median, window: 101}\n",
            "5:36: error[out-of-range]: 'window' is 101, expected 1 to 100",
        ),
        (
            "learning: {rates: {age: 1.5}}\n",
            "5:25: error[out-of-range]: 'rates' of age is 1.5, expected 0 to 1",
        ),
        (
            "learning: {drift: {age: 4.5}}\n",
            "5:25: error[out-of-range]: 'drift' of age is 4.5, expected 0 to 4",
        ),
        (
            "learning: {retreat: {age: 5.5}}\n",
            "5:27: error[out-of-range]: 'retreat' of age is 5.5, expected 1 to 5",
        ),
        (
            "learning: {retreat: {age: 1}, freeze: [age]}\n",
            "5:31: error[contradiction]: 'retreat' says where age goes, 'freeze' that it does "
            "not learn",
        ),
        (
            "learning: {drift: {agge: 1}}\n",
            "5:20: error[unknown-name]: there is no scene parameter 'agge'",
        ),
        (
            "learning: {freeze: age}\n",
            "5:20: error[wrong-type]: 'freeze': expected a list of parameters, or 'all', found "
            "'age'",
        ),
        (
            "learning: {freeze: [age, stress]}\n",
            "5:26: error[unknown-name]: there is no scene parameter 'stress'",
        ),
        (
            "learning: {weights: {button: -1}}\n",
            "5:30: error[out-of-range]: the weight of 'button' is -1, expected 0 to 100",
        ),
        (
            "learning: {layers: [persons]}\n",
            "5:21: error[bad-choice]: a layer is 'persons', expected person or place",
        ),
        (
            "learning: median\n",
            "5:11: error[wrong-type]: 'learning': expected a mapping with the keys 'rate', "
            "'rates', 'freeze', 'update', 'width', …, found 'median'",
        ),
        (
            "weights: {age: -1}\n",
            "5:16: error[out-of-range]: 'weights' of age is -1, expected 0 to 100",
        ),
        ("weights: 2\n", "5:10: error[wrong-type]: 'weights': expected a mapping of numbers for "
         "age, familiarity, mood, found '2'"),
        (
            "feedback: [{when: live.age >= 4, give: negative, baseline: 3 s}]\n",
            "5:50: error[misplaced-key]: 'baseline' has nothing to act on here: the rule does "
            "not look at mood.change",
        ),
        (
            RULE.format("then: cancel, cooldown: 3 s"),
            "5:66: error[misplaced-key]: 'cooldown' has nothing to act on here: the rule ends "
            "the run",
        ),
        (
            RULE.format("then: cancel, release: live.person"),
            "5:66: error[misplaced-key]: 'release' has nothing to act on here: the rule ends "
            "the run",
        ),
        (
            RULE.format("confidence: 2"),
            "5:64: error[out-of-range]: 'confidence' is 2, expected 0 to 1",
        ),
        (
            RULE.format("release: live.mod > 1"),
            "5:61: error[unknown-name]: there is no name 'live.mod' here",
        ),
        (
            RULE.format("baseline: soon"),
            "5:62: error[bad-duration]: 'baseline': expected a time such as '8 s', found 'soon'",
        ),
    ],
)  # fmt: skip
def test_mistake_is_one_positioned_error(text, line):
    assert errors(text) == [line]


def test_unknown_update_adds_no_window_error():
    assert len(errors("learning: {update: medium, window: 3}\n")) == 1


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
