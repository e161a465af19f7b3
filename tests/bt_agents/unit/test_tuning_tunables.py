# SPDX-License-Identifier: Apache-2.0
"""Values that a parameter accepts, and messages for values that it refuses."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bt_agents.host.tuning.tunable import TICK_RATE, format_value, parameters_of
from bt_agents_core.errors import Refused
from bt_agents_core.field_types import FieldType
from tree_harness import agent

HEAD = """
learning_rate: 0.3
tunables:
  patience: {default: 8 s, min: 2 s, max: 2 min, description: how long}
  rate: {default: 0.9, min: 0.5, max: 1.5, step: 0.05, description: speed}
  attempts: {default: 2, min: 1, max: 5}
  loud: {default: true}
  place: {default: station 4}
  distance: {default: 1.5 m}
  turn: {default: 90 deg, min: 0 deg, max: 180 deg}
"""
PARAMETERS = {one.key: one for one in (*parameters_of(agent("wait: 0 s", HEAD)), TICK_RATE)}


def test_agent_parameters_include_tunables_and_learning_rate():
    first, *_, last = parameters_of(agent("wait: 0 s", HEAD))
    assert first.name == "a.patience"
    assert (last.name, last.default) == ("a.learning_rate", 0.3)


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("patience", "12", 12.0),
        ("patience", "12 s", 12.0),
        ("patience", "2 min", 120.0),
        ("rate", "1.05", 1.05),
        ("attempts", "5", 5),
        ("loud", "false", False),
        ("place", "8 s", "8 s"),
        ("distance", "20 cm", 0.2),
        ("turn", "180 deg", math.pi),
        ("tick_rate", "30", 30.0),
    ],
)
def test_text_parses_as_in_an_agent_file(key, text, value):
    read = PARAMETERS[key].read(text)
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    ("key", "text", "words"),
    [
        ("patience", "1", r"OUT_OF_RANGE: a\.patience is 1 s, expected 2 s to 2 min"),
        ("patience", "12 m", r"NOT_A_VALUE: a\.patience: .*write 12 min for minutes"),
        ("patience", "soon", "NOT_A_VALUE: a.patience: expected a time such as '8 s', found"),
        ("rate", "0.93", r"OFF_STEP: a\.rate is 0\.93, .* the nearest is 0\.95"),
        ("rate", "1,1", "NOT_A_VALUE: .*use a point"),
        ("rate", "inf", "NOT_A_VALUE"),
        ("attempts", "2.5", "NOT_A_VALUE: .*a whole number"),
        ("attempts", "6", "OUT_OF_RANGE: a.attempts is 6, expected 1 to 5"),
        ("attempts", "9" * 30, "NOT_A_VALUE"),
        ("loud", "yes", "NOT_A_VALUE: a.loud: expected true or false, found 'yes'"),
        ("place", "\a", "NOT_A_VALUE: a.place has a control character"),
        ("place", "x" * 1001, "NOT_A_VALUE: a.place has 1001 characters, expected at most 1000"),
        ("learning_rate", "1.1", "OUT_OF_RANGE"),
        ("tick_rate", "0", "OUT_OF_RANGE: .*expected 1 to 200"),
    ],
)
def test_invalid_text_is_refused_with_reason(key, text, words):
    with pytest.raises(Refused, match=words):
        PARAMETERS[key].read(text)


@pytest.mark.parametrize(
    ("key", "value", "code"),
    [
        ("patience", math.nan, "NOT_FINITE"),
        ("distance", math.inf, "NOT_FINITE"),
        ("patience", 12, "WRONG_TYPE"),
        ("attempts", 2.0, "WRONG_TYPE"),
        ("attempts", True, "WRONG_TYPE"),
        ("loud", 1, "WRONG_TYPE"),
        ("place", 3.0, "WRONG_TYPE"),
    ],
)
def test_value_of_wrong_type_is_refused(key, value, code):
    with pytest.raises(Refused, match=f"^{code}: "):
        PARAMETERS[key].check(value)


def test_duration_without_range_is_still_validated():
    parameter = replace(PARAMETERS["patience"], minimum=None, maximum=None)
    assert parameter.check(3600.0) == 3600.0
    for value in (-1.0, 1e12):
        with pytest.raises(Refused, match="OUT_OF_RANGE"):
            parameter.check(value)


@pytest.mark.parametrize("value", [0.0, 0.1, 0.35])
def test_range_limit_is_allowed_off_step(value):
    rate = replace(PARAMETERS["rate"], default=0.0, minimum=-0.3, maximum=0.35, step=0.1)
    assert rate.check(value) == value


@pytest.mark.parametrize(
    ("value", "field_type", "text"),
    [
        (8.0, FieldType.DURATION, "8 s"),
        (120.0, FieldType.DURATION, "2 min"),
        (100.0, FieldType.DURATION, "100 s"),
        (0.8, FieldType.NUMBER, "0.8"),
        (3.0, FieldType.NUMBER, "3"),
        (0.1 + 0.2, FieldType.NUMBER, "0.30000000000000004"),
        (True, FieldType.BOOLEAN, "true"),
        (math.pi / 2, FieldType.ANGLE, "90 deg"),
    ],
)
def test_value_is_formatted_in_author_notation(value, field_type, text):
    assert format_value(value, field_type) == text
