# SPDX-License-Identifier: Apache-2.0
"""The mood of a run against its start."""

from __future__ import annotations

import math

import pytest

from bt_agents import mood
from bt_agents.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue

NAN = math.nan
SPACE = SceneSpace(
    parameters=(
        SceneParameter(name="age", minimum=1.0, maximum=5.0, default=3.0),
        SceneParameter(name="mood", minimum=1.0, maximum=5.0, default=3.0),
    ),
    mood="mood",
)


def scene(value: float, *, person: bool = True) -> Scene:
    known = SceneValue(name="mood", value=value, origin=Origin.MEASURED)
    return Scene(
        scene_id="s1",
        label="",
        person=person,
        values=(
            SceneValue.missing("age"),
            SceneValue.missing("mood") if math.isnan(value) else known,
        ),
    )


def changes(awarded: Scene, *lives: Scene, space: SceneSpace = SPACE) -> list[float]:
    current, result = mood.at_start(awarded, space), []
    for live in lives:
        current = mood.seen(current, live, space)
        result.append(current.change)
    return result


def test_the_change_is_measured_against_the_scene_as_awarded():
    assert changes(scene(4.0), scene(4.0), scene(2.5), scene(5.0)) == [0.0, -1.5, 1.0]


def test_without_an_awarded_mood_the_first_known_live_one_is_the_start():
    seen = changes(scene(NAN), scene(NAN), scene(3.0), scene(2.0))
    assert seen == pytest.approx([NAN, 0.0, -1.0], nan_ok=True)


def test_a_missing_live_mood_makes_the_change_unknown_until_it_is_back():
    seen = changes(scene(4.0), scene(3.0), scene(NAN), scene(3.0))
    assert seen == pytest.approx([-1.0, NAN, -1.0], nan_ok=True)


def test_a_person_who_is_gone_has_no_mood():
    seen = changes(scene(4.0), scene(1.0, person=False), scene(4.0))
    assert seen == pytest.approx([NAN, 0.0], nan_ok=True)


def test_a_scene_without_a_person_gives_no_start():
    assert changes(scene(1.0, person=False), scene(4.0), scene(5.0)) == [0.0, 1.0]


def test_a_space_without_a_mood_knows_no_change():
    space = SceneSpace(parameters=SPACE.parameters, mood=None)
    assert changes(scene(4.0), scene(1.0), space=space) == pytest.approx([NAN], nan_ok=True)
