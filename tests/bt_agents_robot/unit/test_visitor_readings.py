# SPDX-License-Identifier: Apache-2.0
"""Sensor readings of a simulated visitor."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bt_agents_core.diagnostic import Position
from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.model.scene_specs import SceneSpec, SourceSpec
from bt_agents_language.model.specs import Script, Visit
from bt_agents_robot.people import (
    PAUSE_S,
    check_visitors,
    field_value,
    is_measured,
    nested,
    pause_after,
    readings,
)

SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0)
        for name in ("age", "mood")
    )
)


def source(parameter: str, *points: tuple[float, float], stale_after_s: float = 5.0) -> SourceSpec:
    return SourceSpec(
        parameter=parameter,
        topic=f"sensors/{parameter}",
        type="std_msgs/msg/Float64",
        field=parse_expression("msg.data"),
        points=points,
        stale_after_s=stale_after_s,
        position=Position(file="scene.yaml", line=1, column=1),
    )


AGE = source("age", (0.0, 1.0), (80.0, 5.0))
MOOD = source("mood")
PERSON = source("person")
WORDS = replace(MOOD, table=(("sad", 1.0), ("calm", 3.0), ("happy", 5.0)))
SPEC = SceneSpec(space=SPACE, sources=(AGE, MOOD), person=PERSON)
WORDED = SceneSpec(space=SPACE, sources=(WORDS,), person=None)


def test_scene_values_convert_back_to_readings():
    found = readings(SPEC, {"age": 3.0, "mood": 4.5}, person=True)
    assert found == {AGE: 40.0, MOOD: 4.5, PERSON: 1.0}


def test_reading_uses_nearest_word_of_table():
    assert readings(WORDED, {"mood": 3.8}, person=True) == {WORDS: "calm"}


@pytest.mark.parametrize(
    ("person", "measured", "expected"),
    [
        (True, {"age": 3.0, "mood": 4.5}, True),
        (True, {"age": 3.3, "mood": 4.2}, True),
        (False, {"age": 3.0, "mood": 4.5}, False),
        (True, {"age": 3.0}, False),
        (True, {"age": 3.0, "mood": 2.0}, False),
    ],
)
def test_visitor_is_measured_once_scene_matches_sent_values(person, measured, expected):
    values = {"age": 3.0, "mood": 4.5}
    assert is_measured(SPEC, values, True, person, measured) is expected


def test_table_words_decide_whether_visitor_is_measured():
    assert is_measured(WORDED, {"mood": 3.8}, True, False, {"mood": 3.0})
    assert not is_measured(WORDED, {"mood": 3.8}, True, False, {"mood": 5.0})


def test_unknown_visitor_value_has_no_reading():
    found = readings(SPEC, {"mood": 4.5}, person=False)
    assert math.isnan(found[AGE])
    assert found[PERSON] == 0.0


@pytest.mark.parametrize(
    ("example", "reading", "value"),
    [
        (False, 1.0, True),
        (False, 0.0, False),
        (False, "true", True),
        (False, "false", False),
        (0, 2.6, 3),
        (0, "2", 2),
        (0, math.nan, 0),
        (0.0, 2.6, 2.6),
        ("", "calm", "calm"),
        ("", math.nan, ""),
    ],
)
def test_reading_takes_its_field_type(example, reading, value):
    found = field_value(example, reading)
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    ("example", "reading", "words"),
    [("", 1.0, "boolean or a number"), (0.0, "calm", "a float, expected a text")],
)
def test_field_cannot_carry_a_reading_of_other_type(example, reading, words):
    with pytest.raises(TypeError, match=words):
        field_value(example, reading)


def test_dotted_paths_become_nested_fields():
    fields = [("a.b", 1), ("a.c", 2), ("d", 3)]
    assert nested(fields) == {"a": {"b": 1, "c": 2}, "d": 3}


def visit(**values: float) -> Visit:
    return Visit(label="", person=True, values=values)


def test_next_visitor_comes_after_short_pause():
    assert pause_after(SPEC, {"age", "mood"}, visit(age=1.0, mood=1.0), pace=1.0) == PAUSE_S
    assert pause_after(SPEC, {"age"}, visit(age=1.0), pace=10.0) == pytest.approx(PAUSE_S / 10)


def test_less_known_visitor_waits_for_stale_readings():
    assert pause_after(SPEC, {"age", "mood"}, visit(mood=1.0), pace=10.0) > AGE.stale_after_s
    assert pause_after(SPEC, {"age"}, None, pace=10.0) > AGE.stale_after_s
    never_stale = replace(SPEC, sources=(replace(AGE, stale_after_s=math.inf),), person=None)
    assert pause_after(never_stale, {"age"}, None, pace=1.0) == PAUSE_S


def test_named_visitor_without_name_sensor_is_refused():
    visits = (Visit(label="anna comes", person=True, values={}, name="anna"),)
    with pytest.raises(Refused, match="'anna comes' has the name 'anna'") as found:
        check_visitors(SPEC, Script(title="", visits=visits))
    assert found.value.code == "NAMED_VISITOR"
    check_visitors(SPEC, Script(title="", visits=(replace(visits[0], name=""),)))
