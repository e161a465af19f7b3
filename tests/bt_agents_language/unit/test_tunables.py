# SPDX-License-Identifier: Apache-2.0
"""Tunables: the default determines the type, and one slip causes one error."""

from __future__ import annotations

import math

import pytest

from agent_texts import refusal
from bt_agents_core.field_types import FieldType
from bt_agents_language.files.tunable_reader import read_tunable
from bt_agents_language.model.specs import Tunable
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping


def tunable(text: str) -> Tunable | None:
    """Return the tunable in braces in a text.

    Raises:
        ReadError: The text is invalid.
    """
    reading = TypedReader(Source("a.yaml", f"t: {{{text}}}\n"))
    assert isinstance(reading.root, Mapping)
    read = read_tunable(reading, reading.root.entries[0], "t")
    reading.problems.raise_if_any()
    return read


@pytest.mark.parametrize(
    ("text", "field_type", "values"),
    [
        ("default: 2, min: 1, max: 5, step: 1", FieldType.INTEGER, (2, 1, 5, 1)),
        ("default: 2.0, min: 1, max: 5", FieldType.NUMBER, (2.0, 1.0, 5.0, 0)),
        ("default: 2, min: 1, max: 5.5", FieldType.NUMBER, (2.0, 1.0, 5.5, 0)),
        ("default: 1, min: 0.5, max: 1.5, step: 0.05", FieldType.NUMBER, (1.0, 0.5, 1.5, 0.05)),
        # The largest value may lie between two steps, as in ROS.
        ("default: 1.0, min: 0.0, max: 1.0, step: 0.3", FieldType.NUMBER, (1.0, 0.0, 1.0, 0.3)),
        ("default: 8 s, min: 500 ms, max: 1 min", FieldType.DURATION, (8.0, 0.5, 60.0, 0)),
        ("default: 90, min: 1 s, max: 2 min", FieldType.DURATION, (90.0, 1.0, 120.0, 0)),
        ("default: 1.5 m, min: 50 cm, max: 2", FieldType.LENGTH, (1.5, 0.5, 2.0, 0)),
        ("default: 180 deg, min: 0, max: 7 rad", FieldType.ANGLE, (math.pi, 0.0, 7.0, 0)),
        ("default: true", FieldType.BOOLEAN, (True, None, None, 0)),
        ("default: kitchen", FieldType.TEXT, ("kitchen", None, None, 0)),
        ('default: "2 m"', FieldType.TEXT, ("2 m", None, None, 0)),
    ],
)
def test_default_and_range_determine_type(text, field_type, values):
    read = tunable(text)
    assert read.type is field_type
    assert type(read.default) is type(values[0])
    assert (read.default, read.minimum, read.maximum, read.step) == values


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("default: 30 s, min: 1 s, max: 10 s", "out-of-range", "is 30 s, expected 1 s to 10 s"),
        ("default: 1 s, min: 2 min, max: 1 s", "out-of-range", "is 1 s, which is not more than"),
        ("default: 100 deg, min: 0, max: 90 deg", "out-of-range", "100 deg, expected 0 deg to 90"),
        ("default: 7 s, min: 5 s, max: 1 min, step: 5 s", "off-step", "of steps of 5 s"),
        ("default: soon, min: 1, max: 3", "bad-number", "found 'soon'"),
        ('default: "2", min: 1, max: 3, step: 1', "unknown-key", "has no 'min', 'max', 'step'"),
        ("default: 9, min: 5, max: 1, step: 0", "out-of-range", "'max' of tunable"),
        ("default: 9, step: -1", "missing-key", "needs min and max"),
    ],
)
def test_tunable_error_is_reported_once_with_unit(text, code, words):
    (problem,) = refusal(tunable, text).diagnostics
    assert problem.code == code
    assert words in problem.message


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("default: 8 m, min: 2 s, max: 30 s", ["a.yaml:1:14"]),
        ("default: 8 s, min: 2 m, max: 30 m", ["a.yaml:1:24", "a.yaml:1:34"]),
    ],
)
def test_minutes_written_as_metres_are_one_error_each(text, places):
    assert [str(one.position) for one in refusal(tunable, text).diagnostics] == places
