# SPDX-License-Identifier: Apache-2.0
"""Scenes from readings and given values: a missing value is not zero, the newer one counts."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Origin, Scene, SceneValue
from bt_agents_language.model.scene_specs import SceneSpec
from scene_layer.run_tracker import LiveRun, RunTracker
from scene_layer.scene_estimator import MAX_INTERACTIONS, check_given
from scene_layer_harness import SceneLayerHarness, number_source, words
from scene_spaces import AGE_AND_MOOD as SPACE

SOURCES = (number_source("age"), number_source("mood"))
SPEC = SceneSpec(space=SPACE, sources=SOURCES, person=None)


@pytest.fixture
def lab() -> SceneLayerHarness:
    return SceneLayerHarness(SPEC)


@pytest.fixture
def watched() -> SceneLayerHarness:
    """A scene layer with a source that says whether a person is present."""
    return SceneLayerHarness(replace(SPEC, person=number_source("person")))


def test_unread_value_is_missing(lab):
    scene = lab.scene(now=0.0)
    assert words(scene) == ["age", "mood"]
    assert all(math.isnan(value.value) and math.isnan(value.age_s) for value in scene.values)
    assert SPACE.scene(scene.values) == scene.values


def test_reading_has_an_age_and_goes_stale(lab):
    lab.hear(4.0, "mood", 10.0)
    assert words(lab.scene(now=11.5)) == ["age", "mood measured 4"]
    assert lab.scene(now=11.5).values[1].age_s == pytest.approx(1.5)
    assert words(lab.scene(now=12.0)) == ["age", "mood measured 4"]
    assert words(lab.scene(now=12.1)) == ["age", "mood"]


def test_given_value_holds_until_newer_reading_arrives(lab):
    lab.hear(4.0, "mood", 1.0)
    lab.estimate.begin("s", "", {"mood": 2.0}, None, 2.0)
    assert words(lab.scene(now=1000.0)) == ["age", "mood given 2"]
    lab.hear(5.0, "mood", 1001.0)
    assert words(lab.scene(now=1001.5)) == ["age", "mood measured 5"]
    silent = words(lab.scene(now=1010.0))
    assert silent == ["age", "mood"], "the sensor lived, and has fallen silent"


def test_given_value_and_urgency_count_for_own_interaction(lab):
    lab.estimate.begin("running", "", {"mood": 4.0}, None, 1.0, urgent=True)
    lab.estimate.begin("waiting", "", {"mood": 1.0}, None, 2.0)
    lab.estimate.give("running", {"age": 2.0}, None, 2.0)
    running, waiting = lab.scene("running", 3.0), lab.scene("waiting", 3.0)
    assert words(running) == ["age given 2", "mood given 4"]
    assert words(waiting) == ["age", "mood given 1"]
    assert (running.urgent, waiting.urgent) == (True, False)


def test_foreign_scene_is_adopted_with_its_given_values(lab):
    values = (
        SceneValue(name="age", value=4.0, origin=Origin.MEASURED, age_s=0.1),
        SceneValue(name="mood", value=2.0, origin=Origin.GIVEN),
    )
    foreign = Scene(scene_id="s", label="from elsewhere", person=True, values=values)
    lab.estimate.adopt(foreign, 1.0)
    assert words(lab.scene(now=2.0)) == ["age", "mood given 2"]
    assert lab.scene(now=2.0).label == "from elsewhere"


def test_adopting_known_scene_keeps_newer_given_values(lab):
    lab.estimate.begin("s", "", {"mood": 4.0}, None, 1.0)
    awarded = lab.scene(now=1.0)
    lab.estimate.give("s", {"mood": 2.0}, None, 2.0)
    lab.estimate.adopt(awarded, 3.0)
    assert words(lab.scene(now=4.0)) == ["age", "mood given 2"]


@pytest.mark.parametrize("follow_up", ["s+1", "s+12", "s+again", "s+again+1"])
def test_given_values_hold_in_follow_up_rounds(watched, follow_up):
    watched.estimate.begin("s", "words", {"age": 4.0, "mood": 4.0}, True, 1.0)
    awarded = watched.scene(now=1.0).with_id(follow_up)
    watched.hear(2.0, "mood", 2.0)
    watched.estimate.adopt(awarded, 3.0)
    scene = watched.scene(follow_up, 3.5)
    assert (scene.scene_id, scene.label, scene.person) == (follow_up, "words", True)
    assert words(scene) == ["age given 4", "mood measured 2"]
    watched.estimate.give(follow_up, {"mood": 1.0}, None, 4.0)
    later = words(watched.scene("s+2", 4.5))
    assert later[1] == "mood given 1", "the round after it is of the same interaction"
    watched.hear(False, "person", 5.0)
    assert not watched.scene(follow_up, 5.5).person


def test_person_of_foreign_scene_is_present_until_measurement(watched):
    missing = tuple(SceneValue.missing(name) for name in SPACE.names)
    watched.estimate.adopt(Scene(scene_id="s", label="", person=True, values=missing), 1.0)
    assert watched.scene(now=100.0).person
    watched.hear(True, "person", 101.0)
    assert watched.scene(now=102.0).person
    assert not watched.scene(now=110.0).person, "the sensor lived, and has fallen silent"


def test_oldest_interactions_are_forgotten_first(lab):
    for number in range(MAX_INTERACTIONS + 1):
        lab.estimate.begin(str(number), "", {"mood": 4.0}, None, 0.0)
    assert words(lab.scene("0", 0.0)) == ["age", "mood"]
    assert words(lab.scene("1", 0.0)) == ["age", "mood given 4"]


def test_any_reading_implies_a_person_without_person_source(lab, watched):
    assert not lab.scene(now=0.0).person
    for layer in (lab, watched):
        layer.hear(4.0, "mood", 0.0)
    assert (lab.scene(now=0.5).person, watched.scene(now=0.5).person) == (True, False)
    watched.hear(True, "person", 1.0)
    assert (lab.scene(now=2.0).person, watched.scene(now=2.0).person) == (True, True)
    assert (lab.scene(now=3.5).person, watched.scene(now=3.5).person) == (False, False)


@pytest.mark.parametrize(("raw", "there"), [(0, False), (0.4, False), (0.5, True), (3, True)])
def test_person_may_be_read_as_count_or_confidence(watched, raw, there):
    watched.hear(raw, "person", 0.0)
    assert watched.scene(now=0.0).person is there


def test_given_person_holds_until_source_sends_again(watched):
    watched.hear(True, "person", 0.0)
    watched.estimate.begin("s", "ladder", {}, False, 1.0)
    assert not watched.scene(now=1.5).person
    watched.hear(True, "person", 2.0)
    assert watched.scene(now=2.5).person


@pytest.mark.parametrize(
    ("names", "values", "code"),
    [
        (["mood"], [], "WRONG_LENGTH"),
        ([], [1.0], "WRONG_LENGTH"),
        (["mood", "mood"], [1.0, 1.0], "DUPLICATE_PARAMETER"),
        (["mod"], [1.0], "UNKNOWN_PARAMETER"),
        (["mood"], [math.nan], "NOT_FINITE"),
        (["mood"], [0.99], "OUT_OF_RANGE"),
    ],
)
def test_invalid_given_values_are_rejected_with_code(names, values, code):
    with pytest.raises(Refused, match=f"^{code}:"):
        check_given(SPACE, names, values)


def run(number: int, epoch: str = "e") -> LiveRun:
    return LiveRun(epoch=epoch, round=number, scene_id=f"s{number}")


@pytest.fixture
def following() -> RunTracker:
    return RunTracker()


def test_run_is_live_from_start_to_end(following):
    assert following.started(run(2))
    following.ended("e", 1)
    following.ended("other", 2)
    assert following.run == run(2), "the end of another run ends nothing"
    following.ended("e", 2)
    assert following.run is None
    assert following.started(run(3))
    following.market("new", 0, idle=True)
    assert following.run is None, "a restarted market ends earlier runs"


def test_start_arriving_after_its_end_starts_nothing(following):
    following.ended("e", 1)
    assert not following.started(run(1))
    assert following.started(run(2))


def test_start_older_than_market_round_starts_nothing(following):
    following.market("e", 3, idle=True)
    assert not following.started(run(2))
    assert not following.started(run(3)), "idle: the last round is over"
    assert following.started(run(4)), "its status may be on the way"
    following.market("e", 4, idle=False)
    assert following.run == run(4)
