# SPDX-License-Identifier: Apache-2.0
"""The one validator of vectors: what it takes, and the name of every refusal."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.scene import (
    Origin,
    Scene,
    SceneParameter,
    SceneSpace,
    SceneValue,
    first_id,
    follow_up_id,
    mood_of,
    origin_id,
)

NAN, INF = math.nan, math.inf

SPACE = SceneSpace(
    parameters=(
        SceneParameter(name="age", minimum=1, maximum=5, default=3),
        SceneParameter(name="mood", minimum=1, maximum=5, default=3),
    ),
    mood="mood",
)


def measured(name: str, value: float) -> SceneValue:
    return SceneValue(name=name, value=value, origin=Origin.MEASURED)


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ([NAN, 3], "NOT_FINITE"),
        ([INF, 3], "NOT_FINITE"),
        ([-INF, 3], "NOT_FINITE"),
        ([], "WRONG_LENGTH"),
        ([3], "WRONG_LENGTH"),
        ([3, 3, 3], "WRONG_LENGTH"),
        ([0.99, 3], "OUT_OF_RANGE"),
        ([3, 5.01], "OUT_OF_RANGE"),
        (["three", 3], "NOT_A_NUMBER"),
        ([None, 3], "NOT_A_NUMBER"),
    ],
)
def test_a_bad_vector_is_refused_with_its_name(values: list[float], code: str) -> None:
    with pytest.raises(Refused) as refused:
        SPACE.vector(values, what="bid of guide")
    assert refused.value.code == code
    assert refused.value.reason.startswith("bid of guide: ")


def test_a_good_vector_is_returned_as_floats() -> None:
    assert SPACE.vector([1, 5]) == (1.0, 5.0)


def test_nan_stands_for_a_missing_value_only_where_that_is_allowed() -> None:
    assert math.isnan(SPACE.vector([NAN, 5], missing=True)[0])
    with pytest.raises(Refused):
        SPACE.vector([INF, 5], missing=True)


def test_named_values_are_put_in_order_and_every_name_is_needed() -> None:
    assert SPACE.from_mapping({"mood": 2, "age": 4}) == (4.0, 2.0)
    with pytest.raises(Refused, match="no value for mood"):
        SPACE.from_mapping({"age": 4})
    with pytest.raises(Refused, match="no scene parameter 'moood'; there are age, mood"):
        SPACE.from_mapping({"age": 4, "moood": 2})


def test_what_is_missing_is_nan_in_order_and_left_out_by_name() -> None:
    vector = SPACE.ordered({"mood": 2.0})
    assert math.isnan(vector[0])
    assert vector[1] == 2.0
    assert SPACE.named(vector) == {"mood": 2.0}


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ([], "EMPTY"),
        ([measured("age", 3)], "WRONG_LENGTH"),
        ([measured("age", 3), measured("age", 3)], "DUPLICATE_PARAMETER"),
        ([measured("age", 3), measured("size", 3)], "UNKNOWN_PARAMETER"),
        ([measured("age", NAN), measured("mood", 3)], "NOT_FINITE"),
        ([measured("age", 6), measured("mood", 3)], "OUT_OF_RANGE"),
        (
            [SceneValue(name="age", value=3, origin=Origin.MISSING), measured("mood", 3)],
            "ORIGIN_MISMATCH",
        ),
    ],
)
def test_a_bad_scene_is_refused_with_its_name(values: list[SceneValue], code: str) -> None:
    with pytest.raises(Refused) as refused:
        SPACE.scene(values)
    assert refused.value.code == code


def test_a_scene_comes_back_in_the_order_of_the_space() -> None:
    values = SPACE.scene([SceneValue.missing("mood"), measured("age", 4)])
    assert [value.name for value in values] == ["age", "mood"]
    assert values[0].value == 4
    assert math.isnan(values[1].value)


def test_clamping_moves_into_the_range_and_keeps_what_is_missing() -> None:
    low, high = SPACE.clamp((0.0, 9.0))
    assert (low, high) == (1.0, 5.0)
    assert math.isnan(SPACE.clamp((NAN, 3.0))[0])


@pytest.mark.parametrize(
    ("scene_id", "origin", "first"),
    [
        ("s1", "s1", "s1"),
        ("s1+2", "s1", "s1"),
        ("s1+again", "s1+again", "s1"),
        ("s1+again+12", "s1+again", "s1"),
        ("a+b", "a+b", "a+b"),
        ("+", "+", "+"),
        ("", "", ""),
    ],
)
def test_the_id_of_a_scene_tells_which_one_it_goes_back_to(
    scene_id: str, origin: str, first: str
) -> None:
    assert (origin_id(scene_id), first_id(scene_id)) == (origin, first)
    assert origin_id(follow_up_id(origin, 3)) == origin


def with_pain() -> SceneSpace:
    pain = SceneParameter(name="pain", minimum=0, maximum=10, default=0, profiled=False)
    return SceneSpace(parameters=(pain, *SPACE.parameters), mood="mood")


def test_parameters_that_no_profile_has_come_last() -> None:
    space = with_pain()
    assert space.names == ("age", "mood", "pain")
    assert (space.profiles.names, space.profiles.left_out) == (("age", "mood"), ("pain",))
    assert SPACE.profiles is SPACE


def test_a_profile_is_not_asked_for_what_no_profile_has() -> None:
    profiles = with_pain().profiles
    assert profiles.from_mapping({"age": 2, "mood": 3}) == (2.0, 3.0)
    with pytest.raises(Refused, match="no profile has 'pain'") as refused:
        profiles.from_mapping({"age": 2, "mood": 3, "pain": 1})
    assert refused.value.code == "UNKNOWN_PARAMETER"


def test_profiles_are_compared_with_the_values_that_they_have() -> None:
    space = with_pain()
    values = space.scene([measured("pain", 8), measured("age", 2), measured("mood", 3)])
    scene = Scene(scene_id="s", label="", person=True, values=values)
    compared = space.profiles.compared(scene)
    assert (compared.vector, compared.observed) == ((2.0, 3.0), (2.0, 3.0))
    assert scene.get("pain") == 8.0
    assert space.compared(scene) is scene


def test_a_mood_may_be_what_no_profile_has() -> None:
    mood = SceneParameter(name="mood", minimum=1, maximum=5, default=3, profiled=False)
    space = SceneSpace(parameters=(mood, SPACE.parameters[0]), mood="mood")
    values = space.scene([measured("mood", 4), measured("age", 2)])
    assert mood_of(Scene(scene_id="s", label="", person=True, values=values), space) == 4.0
    assert space.profiles.mood is None


def test_two_missing_values_of_a_parameter_are_equal_wherever_their_nans_come_from() -> None:
    missing = SceneValue.missing("age")
    received = replace(missing, value=float("nan"), age_s=float("nan"), std=float("nan"))
    assert received == missing
    assert hash(received) == hash(missing)
    assert received != SceneValue.missing("mood")
    assert received != replace(missing, confidence=1.0)
    assert received != "age"
