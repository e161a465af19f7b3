# SPDX-License-Identifier: Apache-2.0
"""The validator of vectors: what it accepts, and the code of every refusal."""

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


def measured(name: str, value: float, origin: Origin = Origin.MEASURED) -> SceneValue:
    return SceneValue(name=name, value=value, origin=origin)


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
def test_invalid_vector_is_refused_with_its_name(values: list[float], code: str) -> None:
    with pytest.raises(Refused) as refused:
        SPACE.vector(values, what="bid of guide")
    assert refused.value.code == code
    assert refused.value.reason.startswith("bid of guide: ")


def test_nan_means_missing_only_where_allowed() -> None:
    assert SPACE.vector([1, 5]) == (1.0, 5.0)
    assert math.isnan(SPACE.vector([NAN, 5], missing=True)[0])
    with pytest.raises(Refused):
        SPACE.vector([INF, 5], missing=True)


def test_named_values_are_ordered_and_must_be_complete() -> None:
    assert SPACE.from_mapping({"mood": 2, "age": 4}) == (4.0, 2.0)
    with pytest.raises(Refused, match="no value for mood"):
        SPACE.from_mapping({"age": 4})
    with pytest.raises(Refused, match="no scene parameter 'moood'; there are age, mood"):
        SPACE.from_mapping({"age": 4, "moood": 2})


def test_missing_value_is_nan_in_vector_but_unnamed() -> None:
    vector = SPACE.ordered({"mood": 2.0})
    assert vector == pytest.approx((NAN, 2.0), nan_ok=True)
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
        ([measured("age", 3, Origin.MISSING), measured("mood", 3)], "ORIGIN_MISMATCH"),
    ],
)
def test_invalid_scene_is_refused_with_code(values: list[SceneValue], code: str) -> None:
    with pytest.raises(Refused, match=f"^{code}: "):
        SPACE.scene(values)


def test_scene_values_follow_the_space_order() -> None:
    values = SPACE.scene([SceneValue.missing("mood"), measured("age", 4)])
    assert values == (measured("age", 4), SceneValue.missing("mood"))


def test_clamp_limits_values_and_keeps_missing_ones() -> None:
    assert SPACE.clamp((0.0, 9.0)) == (1.0, 5.0)
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
def test_scene_id_names_its_origin_scene(scene_id: str, origin: str, first: str) -> None:
    assert (origin_id(scene_id), first_id(scene_id)) == (origin, first)
    assert origin_id(follow_up_id(origin, 3)) == origin


def seen(space: SceneSpace, *values: SceneValue) -> Scene:
    return Scene(scene_id="s", label="", person=True, values=space.scene(values))


def with_pain() -> SceneSpace:
    pain = SceneParameter(name="pain", minimum=0, maximum=10, default=0, profiled=False)
    return SceneSpace(parameters=(pain, *SPACE.parameters), mood="mood")


def test_unprofiled_parameters_come_last() -> None:
    space = with_pain()
    assert space.names == ("age", "mood", "pain")
    assert (space.profiles.names, space.profiles.left_out) == (("age", "mood"), ("pain",))
    assert SPACE.profiles is SPACE


def test_profile_excludes_unprofiled_parameters() -> None:
    profiles = with_pain().profiles
    assert profiles.from_mapping({"age": 2, "mood": 3}) == (2.0, 3.0)
    with pytest.raises(Refused, match="no profile has 'pain'") as refused:
        profiles.from_mapping({"age": 2, "mood": 3, "pain": 1})
    assert refused.value.code == "UNKNOWN_PARAMETER"


def test_profiles_are_compared_on_profiled_parameters_only() -> None:
    space = with_pain()
    scene = seen(space, measured("pain", 8), measured("age", 2), measured("mood", 3))
    compared = space.profiles.compared(scene)
    assert (compared.vector, compared.observed) == ((2.0, 3.0), (2.0, 3.0))
    assert scene.get("pain") == 8.0
    assert space.compared(scene) is scene


def test_mood_can_be_unprofiled() -> None:
    mood = SceneParameter(name="mood", minimum=1, maximum=5, default=3, profiled=False)
    space = SceneSpace(parameters=(mood, SPACE.parameters[0]), mood="mood")
    assert mood_of(seen(space, measured("mood", 4), measured("age", 2)), space) == 4.0
    assert space.profiles.mood is None


def test_missing_values_are_equal_despite_distinct_nans() -> None:
    missing = SceneValue.missing("age")
    received = replace(missing, value=float("nan"), age_s=float("nan"), std=float("nan"))
    assert received == missing
    assert hash(received) == hash(missing)
    assert received != SceneValue.missing("mood")
    assert received != replace(missing, confidence=1.0)
    assert received != "age"
