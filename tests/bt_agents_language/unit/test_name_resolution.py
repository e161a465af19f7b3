# SPDX-License-Identifier: Apache-2.0
"""Names and labels of a condition: the same meaning wherever it is evaluated."""

from __future__ import annotations

import math

import pytest

from agent_texts import refusal
from bt_agents_core.errors import ReadError
from bt_agents_core.local_time import LocalTime
from bt_agents_core.scene import nearest_label
from bt_agents_language.expression.expression_values import Undecided, ValueKind
from bt_agents_language.expression.expressions import MissingValue, StaleValue, parse_expression
from bt_agents_language.expression.name_resolution import SceneFacts, resolve, surely_true
from bt_agents_language.fields.scope import NameScope, scene_labels, scene_names
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from tree_harness import SPACE, TreeHarness, agent, scene

AWARDED = SceneFacts(person=True, values={"age": 3.0, "mood": math.nan})
LIVE = SceneFacts(person=False, values={"age": 4.0, "mood": 2.0})
STALE = SceneFacts(person=False, values=LIVE.values, stale_s=2.0)


NIGHT = LocalTime(hour=23, weekday="sunday")


def value(name: str, live: SceneFacts = LIVE) -> object:
    change, profile = lambda seen: seen.get("mood") - 3.0, {"age": 5.0}.__getitem__
    return resolve(name, AWARDED, lambda: live, change, profile, lambda: NIGHT)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("scene.age", 3.0),
        ("scene.person", True),
        ("live.age", 4.0),
        ("live.person", False),
        ("live.stale", False),
        ("mood.change", -1.0),
        ("profile.age", 5.0),
        ("clock.hour", 23),
        ("clock.weekday", "sunday"),
    ],
)
def test_name_has_same_meaning_in_every_condition(name, expected):
    assert value(name) == expected


@pytest.mark.parametrize(
    "name", ["scene.mood", "scene.height", "live.height", "profile.height", "age", "other.age", ""]
)
def test_unknown_name_has_no_value(name):
    with pytest.raises(MissingValue) as missing:
        value(name)
    assert missing.value.name == name


@pytest.mark.parametrize("name", ["live.age", "live.person", "mood.change"])
def test_stale_live_scene_exposes_only_stale_flag(name):
    with pytest.raises(StaleValue):
        value(name, STALE)
    assert value("live.stale", STALE) is True


@pytest.mark.parametrize(
    "name", ["live.age", "live.stale", "mood.change", "profile.age", "clock.hour"]
)
def test_scene_only_condition_resolves_no_other_names(name):
    with pytest.raises(MissingValue):
        resolve(name, AWARDED)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("scene.age >= 3", True),
        ("scene.age > 3", False),
        ("scene.mood > 1", False),
        ("not scene.mood > 1", False),
    ],
)
def test_condition_with_missing_value_is_not_surely_true(text, expected):
    assert surely_true(parse_expression(text), value) is expected


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1 / (scene.age - 3) > 0", "'/' by zero"),
        ("scene.age", "it is the number 3, expected true or false"),
    ],
)
def test_undecided_condition_is_distinct_from_false(text, why):
    with pytest.raises(Undecided) as undecided:
        surely_true(parse_expression(text), value)
    assert str(undecided.value) == f"cannot be decided: {text} ({why})"


WORDS = NameScope(scene_names(SPACE), labels=scene_labels(SPACE))


def label(text: str, **values: float) -> object:
    def lookup(name: str) -> float:
        parameter = name.rpartition(".")[2]
        if parameter not in values:
            raise MissingValue(name)
        return values[parameter]

    return WORDS.parse(text).evaluate(lookup)


@pytest.mark.parametrize(
    ("mood", "word"),
    [(1.0, "upset"), (1.4, "upset"), (1.5, "upset"), (1.6, "unhappy"), (4.9, "delighted")],
)
def test_nearest_label_wins_and_ties_take_smaller_value(mood, word):
    assert label("label(live.mood)", mood=mood) == word


def test_value_far_from_labels_gets_nearest_label():
    assert nearest_label(((1.0, "first"), (3.0, "later")), 90.0) == "later"


def test_a_missing_value_has_no_label():
    with pytest.raises(MissingValue):
        label("label(live.mood)")
    assert label("label(live.mood) else 'quiet'") == "quiet"
    assert label("known(label(live.mood))") is False


def test_label_is_a_text_with_known_words():
    assert WORDS.parse("label(live.mood)").kind is ValueKind.TEXT
    assert label("label(live.mood) == 'upset'", mood=1.0) is True


@pytest.mark.parametrize(
    ("condition", "message", "hint"),
    [
        ("label(live.mood) == 'hapy'", "it is never 'hapy'", "upset, unhappy, neutral, content"),
        ("label(live.mood) > 2", "'>' needs a number on each side", ""),
        ("label(2) == 'upset'", "'label' needs the name of a scene parameter", "label(live.mood)"),
        ("label(live.person) == 'x'", "'label' needs the name of a scene parameter", ""),
        ("label(live.moood) == 'x'", "there is no name 'live.moood' here", "live.mood"),
    ],
)
def test_label_of_unlabelled_value_is_rejected(condition, message, hint):
    found = refusal(agent, f"check: {condition}").diagnostics
    assert [hint in one.hint for one in found if message in one.message] == [True]


def test_skill_speaks_label():
    harness = TreeHarness("say: You look ${label(live.mood)}.", awarded=scene(mood=4.2))
    harness.tick()
    assert harness.said == ["You look content."]


def test_name_set_to_label_cannot_hold_number():
    with pytest.raises(ReadError, match="a text"):
        agent("sequence:\n  - set: {felt: '${label(live.mood)}'}\n  - set: {felt: 3}")


def test_a_mood_rule_may_name_a_label():
    rule = restore_mood_rule(SPACE, when="label(live.mood) == 'upset'", give=2)
    assert rule.when.is_true(lambda _: 1.2) is True
    head = "feedback: [{when: label(live.mood) == 'upset' and mood.change < -1, give: negative}]"
    assert len(agent("wait: 1 s", head).rules) == 1
