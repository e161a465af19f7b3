# SPDX-License-Identifier: Apache-2.0
"""Readings: mapped, checked, and never replaced by a bad one."""

from __future__ import annotations

import math

import pytest

from bt_agents.errors import Refused
from bt_agents.language.specs import Position, SceneSpec, SourceSpec
from bt_agents.scene import SceneParameter, SceneSpace
from scene_layer.sources import Sources, inverted, mapped

SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0)
        for name in ("age", "mood")
    ),
    mood="mood",
)


def source(
    parameter: str, *points: tuple[float, float], topic: str = "", line: int = 1
) -> SourceSpec:
    return SourceSpec(
        parameter=parameter,
        topic=topic or f"sensors/{parameter}",
        type="std_msgs/msg/Float64",
        field="data",
        points=points,
        stale_after_s=2.0,
        position=Position(file="scene.yaml", line=line, column=1),
    )


AGE = source("age", (10.0, 1.0), (20.0, 2.0), (80.0, 5.0))
MOOD = source("mood")
OTHER_MOOD = source("mood", topic="face/mood", line=2)
PERSON = source("person")
SPEC = SceneSpec(space=SPACE, sources=(AGE, MOOD, OTHER_MOOD), person=PERSON)


@pytest.mark.parametrize(
    ("reading", "value"),
    [(-5.0, 1.0), (10.0, 1.0), (15.0, 1.5), (20.0, 2.0), (50.0, 3.5), (80.0, 5.0), (200.0, 5.0)],
)
def test_a_reading_is_mapped_between_the_points_and_held_beyond_them(reading, value):
    assert mapped(AGE, reading) == value


@pytest.mark.parametrize("value", [1.0, 1.5, 2.0, 3.5, 5.0])
def test_an_inverted_value_maps_back_to_itself(value):
    assert mapped(AGE, inverted(AGE, value)) == pytest.approx(value)


def test_falling_and_flat_points_can_be_inverted():
    falling = source("mood", (0.0, 5.0), (1.0, 3.0), (2.0, 3.0), (3.0, 1.0))
    assert [inverted(falling, v) for v in (5.0, 4.0, 3.0, 2.0, 1.0)] == [0.0, 0.5, 1.0, 2.5, 3.0]


def test_a_value_that_no_reading_maps_to_takes_the_nearest_point():
    assert inverted(AGE, 9.0) == 80.0
    assert inverted(AGE, 0.0) == 10.0


def test_without_points_a_reading_is_its_value():
    assert mapped(MOOD, 4.5) == 4.5
    assert inverted(MOOD, 4.5) == 4.5


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (math.nan, "NOT_FINITE"),
        (math.inf, "NOT_FINITE"),
        (-math.inf, "NOT_FINITE"),
        (10**400, "NOT_FINITE"),
        ("4", "NOT_A_NUMBER"),
        (None, "NOT_A_NUMBER"),
        ([4.0], "NOT_A_NUMBER"),
        (0.5, "OUT_OF_RANGE"),
        (5.5, "OUT_OF_RANGE"),
    ],
)
def test_a_bad_reading_is_refused_and_counted_and_the_last_good_one_stays(raw, code):
    sources = Sources(SPEC)
    sources.read(MOOD, 4.0, 10.0)
    for count in (1, 2):
        with pytest.raises(Refused) as refused:
            sources.read(MOOD, raw, 11.0)
        assert refused.value.code == code
        assert "sensors/mood" in refused.value.reason
        assert sources.refusals == {("sensors/mood", code): count}
    reading = sources.latest("mood")
    assert reading is not None
    assert (reading.value, reading.at, reading.stale_at) == (4.0, 10.0, 12.0)


def test_a_reading_out_of_the_map_is_clamped_but_an_endless_one_is_refused():
    sources = Sources(SPEC)
    sources.read(AGE, 1e300, 0.0)
    assert sources.latest("age").value == 5.0
    with pytest.raises(Refused, match="NOT_FINITE"):
        sources.read(AGE, math.inf, 1.0)


def test_of_several_sources_the_one_that_spoke_last_counts():
    sources = Sources(SPEC)
    sources.read(MOOD, 4.0, 1.0)
    sources.read(OTHER_MOOD, 2.0, 2.0)
    assert sources.latest("mood").value == 2.0
    sources.read(MOOD, 5.0, 3.0)
    assert sources.latest("mood").value == 5.0


def test_a_change_is_told_from_a_repetition():
    sources = Sources(SPEC)
    assert sources.read(MOOD, 4.0, 1.0)
    assert not sources.read(MOOD, 4.0, 2.0)
    assert sources.read(MOOD, 3.0, 3.0)
    assert sources.read(MOOD, 3.0, 9.0), "it had been stale, so it is news again"


def test_a_boolean_is_a_reading_of_zero_or_one():
    sources = Sources(SPEC)
    sources.read(PERSON, True, 1.0)
    assert sources.latest_person().value == 1.0
    sources.read(PERSON, False, 2.0)
    assert sources.latest_person().value == 0.0


def test_nobody_is_known_before_the_first_reading():
    assert Sources(SPEC).latest("mood") is None
    assert Sources(SPEC).latest_person() is None
