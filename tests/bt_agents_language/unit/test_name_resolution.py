# SPDX-License-Identifier: Apache-2.0
"""Names of a condition: the same meaning wherever it is evaluated."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.local_time import LocalTime
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.expressions import MissingValue, StaleValue, parse_expression
from bt_agents_language.expression.name_resolution import SceneFacts, resolve, surely_true

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
