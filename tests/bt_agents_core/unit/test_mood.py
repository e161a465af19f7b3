# SPDX-License-Identifier: Apache-2.0
"""The mood of a run relative to its start."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.mood import Addressee, Mood
from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue, mood_of

NAN = math.nan
SPACE = SceneSpace(
    parameters=(
        SceneParameter(name="age", minimum=1.0, maximum=5.0, default=3.0),
        SceneParameter(name="mood", minimum=1.0, maximum=5.0, default=3.0),
    ),
    mood="mood",
)


def scene(
    value: float,
    *,
    person: bool = True,
    origin: Origin = Origin.MEASURED,
    confidence: float = 1.0,
    person_id: str = "",
) -> Scene:
    known = SceneValue(name="mood", value=value, origin=origin, confidence=confidence)
    mood = SceneValue.missing("mood") if math.isnan(value) else known
    values = (SceneValue.missing("age"), mood)
    return Scene(scene_id="s1", label="", person=person, values=values, person_id=person_id)


class Course:
    """The mood of a run, with times relative to its start."""

    def __init__(self, awarded: Scene, *, space: SceneSpace = SPACE, **options: float) -> None:
        self.now = 0.0
        self.mood = Mood(awarded, space, lambda: self.now, **options)

    def see(self, at: float, live: Scene) -> float:
        self.now = at
        self.mood.receive(live)
        return self.mood.change

    def tick(self, at: float) -> float:
        self.now = at
        self.mood.tick()
        return self.mood.change


def changes(awarded: Scene, *lives: Scene, **options: float) -> list[float]:
    course = Course(awarded, **options)
    return [course.see(second, live) for second, live in enumerate(lives)]


def test_mood_change_is_relative_to_awarded_scene():
    assert changes(scene(4.0), scene(4.0), scene(2.5), scene(5.0)) == [0.0, -1.5, 1.0]


UNKNOWN = [
    scene(NAN),
    scene(1.0, person=False),
    scene(5.0, origin=Origin.ESTIMATED),
    scene(5.0, origin=Origin.DEFAULT),
]


@pytest.mark.parametrize("awarded", UNKNOWN)
def test_first_live_mood_replaces_missing_awarded_mood(awarded):
    seen = changes(awarded, scene(NAN), scene(3.0), scene(2.0))
    assert seen == pytest.approx([NAN, 0.0, -1.0], nan_ok=True)


@pytest.mark.parametrize("gap", UNKNOWN)
def test_unobserved_mood_makes_change_unknown(gap):
    seen = changes(scene(4.0), scene(3.0), gap, scene(3.0))
    assert seen == pytest.approx([-1.0, NAN, -1.0], nan_ok=True)


def test_low_confidence_mood_is_unknown():
    lives = [scene(2.0, confidence=c) for c in (0.49, 0.5, 1.0)]
    seen = changes(scene(4.0), *lives, confidence=0.5)
    assert seen == pytest.approx([NAN, -2.0, -2.0], nan_ok=True)


def test_space_without_mood_has_no_mood_change():
    space = SceneSpace(parameters=SPACE.parameters, mood=None)
    assert math.isnan(Course(scene(4.0), space=space).see(0.0, scene(1.0)))


# --- the baseline -------------------------------------------------------------------------


def test_baseline_is_a_time_weighted_mean():
    course = Course(scene(5.0), baseline_s=4.0)
    assert math.isnan(course.see(1.0, scene(2.0)))
    for at in (4.0, 4.1, 4.2, 4.3):
        assert math.isnan(course.see(at, scene(4.0)))
    assert course.mood.due == 5.0
    assert course.tick(5.0) == pytest.approx(4.0 - (3 * 2.0 + 1 * 4.0) / 4)
    assert course.mood.due == math.inf
    assert course.see(9.0, scene(1.5)) == pytest.approx(-1.0)


def test_baseline_excludes_time_without_known_mood():
    course = Course(scene(5.0), baseline_s=4.0)
    course.see(0.0, scene(2.0))
    course.see(1.0, scene(NAN))
    course.see(3.0, scene(3.0))
    assert course.tick(4.0) == pytest.approx(3.0 - 2.5)


def test_baseline_starts_at_first_known_mood():
    course = Course(scene(5.0), baseline_s=2.0)
    course.see(0.0, scene(NAN))
    course.see(10.0, scene(3.0))
    assert course.mood.due == 12.0
    assert course.tick(12.5) == 0.0


def test_baseline_restarts_when_mood_is_lost_immediately():
    course = Course(scene(5.0), baseline_s=2.0)
    course.see(0.0, scene(3.0))
    course.see(0.0, scene(NAN))
    assert math.isnan(course.tick(3.0))
    course.see(4.0, scene(2.0))
    assert course.mood.due == 6.0


# --- whose mood ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("awarded", "lives", "there"),
    [
        ("anna", ["anna", "ben", "anna"], [True, False, True]),
        ("anna", ["", "ben", ""], [True, False, True]),
        ("", ["", "anna", "ben"], [True, True, False]),
    ],
)
def test_other_person_counts_as_absent(awarded, lives, there):
    addressee = Addressee(scene(4.0, person_id=awarded))
    seen = [addressee.mask(scene(1.0, person_id=one)) for one in lives]
    assert [one.person for one in seen] == there
    assert [not math.isnan(mood_of(one, SPACE)) for one in seen] == there


def test_first_measured_mood_replaces_given_mood() -> None:
    course = Course(scene(4.0, origin=Origin.GIVEN))
    assert course.see(0.0, scene(4.0, origin=Origin.GIVEN)) == 0.0
    assert course.see(1.0, scene(3.0)) == 0.0
    assert course.see(2.0, scene(2.0)) == -1.0
    assert course.see(3.0, scene(1.0, origin=Origin.GIVEN)) == -2.0


def test_second_given_mood_counts_as_change() -> None:
    course = Course(scene(4.0, origin=Origin.GIVEN))
    assert course.see(1.0, scene(2.5, origin=Origin.GIVEN)) == -1.5


def test_low_confidence_mood_does_not_replace_given_mood() -> None:
    course = Course(scene(4.0, origin=Origin.GIVEN), confidence=0.5)
    assert math.isnan(course.see(1.0, scene(3.0, confidence=0.2)))
    assert course.see(2.0, scene(2.0)) == 0.0
