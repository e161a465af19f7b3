# SPDX-License-Identifier: Apache-2.0
"""Scenes from readings and given values: a missing value is not zero, the newer one counts."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.diagnostic import Position
from bt_agents_core.errors import Refused
from bt_agents_core.scene import Origin, Scene, SceneValue
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.model.scene_specs import SceneSpec, SourceSpec
from plain_message import message_of
from scene_layer.memory import Memory
from scene_layer.run_tracker import LiveRun, RunTracker
from scene_layer.scene_estimator import MAX_INTERACTIONS, SceneEstimator, check_given
from scene_layer.sources import Sources
from scene_spaces import AGE_AND_MOOD as SPACE


def source(parameter: str) -> SourceSpec:
    return SourceSpec(
        parameter=parameter,
        topic=f"sensors/{parameter}",
        type="std_msgs/msg/Float64",
        field=parse_expression("msg.data"),
        points=(),
        stale_after_s=2.0,
        position=Position(file="scene.yaml", line=1, column=1),
    )


AGE, MOOD, PERSON = source("age"), source("mood"), source("person")


class Lab:
    """An estimate with its sources, and scenes as short texts."""

    def __init__(self, person: SourceSpec | None = None) -> None:
        spec = SceneSpec(space=SPACE, sources=(AGE, MOOD), person=person)
        self.sources = Sources(spec)
        self.estimate = SceneEstimator(spec, self.sources, Memory(SPACE))

    def read(self, source: SourceSpec, value: object, now: float) -> None:
        self.sources.read(source, message_of({"data": value}), now)

    def scene(self, now: float, scene_id: str = "s") -> Scene:
        return self.estimate.scene(scene_id, now=now, wall=0.0, stamp=0.0)

    def values(self, now: float, scene_id: str = "s") -> list[str]:
        return [
            "missing" if v.origin is Origin.MISSING else f"{v.origin.name.lower()} {v.value:g}"
            for v in self.scene(now, scene_id).values
        ]


@pytest.fixture
def lab() -> Lab:
    return Lab()


def test_unread_value_is_missing(lab):
    scene = lab.scene(0.0)
    assert lab.values(0.0) == ["missing", "missing"]
    assert all(math.isnan(value.value) and math.isnan(value.age_s) for value in scene.values)
    assert SPACE.scene(scene.values) == scene.values


def test_reading_has_an_age_and_goes_stale(lab):
    lab.read(MOOD, 4.0, 10.0)
    assert lab.values(11.5) == ["missing", "measured 4"]
    assert lab.scene(11.5).values[1].age_s == pytest.approx(1.5)
    assert lab.values(12.0) == ["missing", "measured 4"]
    assert lab.values(12.1) == ["missing", "missing"]


def test_given_value_holds_until_newer_reading_arrives(lab):
    lab.read(MOOD, 4.0, 1.0)
    lab.estimate.begin("s", "", {"mood": 2.0}, None, 2.0)
    assert lab.values(1000.0) == ["missing", "given 2"]
    lab.read(MOOD, 5.0, 1001.0)
    assert lab.values(1001.5) == ["missing", "measured 5"]
    assert lab.values(1010.0) == ["missing", "missing"], "the sensor lived, and has fallen silent"


def test_given_value_counts_only_for_its_interaction(lab):
    lab.estimate.begin("running", "", {"mood": 4.0}, None, 1.0)
    lab.estimate.begin("waiting", "", {"mood": 1.0}, None, 2.0)
    assert lab.values(3.0, "running") == ["missing", "given 4"]
    assert lab.values(3.0, "waiting") == ["missing", "given 1"]


def test_urgent_scene_stays_urgent_in_its_interaction(lab):
    lab.estimate.begin("alarm", "", {"mood": 4.0}, None, 1.0, urgent=True)
    lab.estimate.begin("calm", "", {"mood": 4.0}, None, 1.0)
    lab.estimate.give("alarm", {"age": 2.0}, None, 2.0)
    assert lab.scene(3.0, "alarm").urgent
    assert not lab.scene(3.0, "calm").urgent


def test_values_given_later_are_added(lab):
    lab.estimate.begin("s", "words", {"mood": 4.0}, True, 1.0)
    lab.estimate.give("s", {"age": 2.0}, None, 2.0)
    assert lab.values(3.0) == ["given 2", "given 4"]
    assert lab.scene(3.0).label == "words"
    assert lab.scene(3.0).person


def test_foreign_scene_is_adopted_with_its_given_values(lab):
    values = (
        SceneValue(name="age", value=4.0, origin=Origin.MEASURED, age_s=0.1),
        SceneValue(name="mood", value=2.0, origin=Origin.GIVEN),
    )
    foreign = Scene(scene_id="s", label="from elsewhere", person=True, values=values)
    lab.estimate.adopt(foreign, 1.0)
    assert lab.values(2.0) == ["missing", "given 2"]
    assert lab.scene(2.0).label == "from elsewhere"


def test_adopting_known_scene_keeps_newer_given_values(lab):
    lab.estimate.begin("s", "", {"mood": 4.0}, None, 1.0)
    awarded = lab.scene(1.0)
    lab.estimate.give("s", {"mood": 2.0}, None, 2.0)
    lab.estimate.adopt(awarded, 3.0)
    assert lab.values(4.0) == ["missing", "given 2"]


@pytest.mark.parametrize("follow_up", ["s+1", "s+12", "s+again", "s+again+1"])
def test_given_values_hold_in_follow_up_rounds(follow_up):
    lab = Lab(PERSON)
    lab.estimate.begin("s", "words", {"age": 4.0, "mood": 4.0}, True, 1.0)
    awarded = lab.scene(1.0).with_id(follow_up)
    lab.read(MOOD, 2.0, 2.0)
    lab.estimate.adopt(awarded, 3.0)
    scene = lab.scene(3.5, follow_up)
    assert (scene.scene_id, scene.label, scene.person) == (follow_up, "words", True)
    assert lab.values(3.5, follow_up) == ["given 4", "measured 2"]
    lab.estimate.give(follow_up, {"mood": 1.0}, None, 4.0)
    assert lab.values(4.5, "s+2")[1] == "given 1", "the round after it is of the same interaction"
    lab.read(PERSON, False, 5.0)
    assert not lab.scene(5.5, follow_up).person


def test_person_of_foreign_scene_is_present_until_measurement():
    lab = Lab(PERSON)
    missing = tuple(SceneValue.missing(name) for name in SPACE.names)
    lab.estimate.adopt(Scene(scene_id="s", label="", person=True, values=missing), 1.0)
    assert lab.scene(100.0).person
    lab.read(PERSON, True, 101.0)
    assert lab.scene(102.0).person
    assert not lab.scene(110.0).person, "the sensor lived, and has fallen silent"


def test_oldest_interactions_are_forgotten_first(lab):
    for number in range(MAX_INTERACTIONS + 1):
        lab.estimate.begin(str(number), "", {"mood": 4.0}, None, 0.0)
    assert lab.values(0.0, "0") == ["missing", "missing"]
    assert lab.values(0.0, "1") == ["missing", "given 4"]


def test_any_reading_implies_a_person_without_person_source(lab):
    assert not lab.scene(0.0).person
    lab.read(MOOD, 4.0, 0.0)
    assert lab.scene(1.0).person
    assert not lab.scene(9.0).person


def test_silent_or_stale_person_source_sees_no_person():
    lab = Lab(PERSON)
    lab.read(MOOD, 4.0, 0.0)
    assert not lab.scene(0.0).person
    lab.read(PERSON, True, 1.0)
    assert lab.scene(2.0).person
    assert not lab.scene(3.5).person


@pytest.mark.parametrize(("raw", "there"), [(0, False), (0.4, False), (0.5, True), (3, True)])
def test_person_may_be_read_as_count_or_confidence(raw, there):
    lab = Lab(PERSON)
    lab.read(PERSON, raw, 0.0)
    assert lab.scene(0.0).person is there


def test_given_person_holds_until_source_sends_again():
    lab = Lab(PERSON)
    lab.read(PERSON, True, 0.0)
    lab.estimate.begin("s", "ladder", {}, False, 1.0)
    assert not lab.scene(1.5).person
    lab.read(PERSON, True, 2.0)
    assert lab.scene(2.5).person


@pytest.mark.parametrize(
    ("names", "values", "code"),
    [
        (["mood"], [], "WRONG_LENGTH"),
        ([], [1.0], "WRONG_LENGTH"),
        (["mood", "mood"], [1.0, 1.0], "DUPLICATE_PARAMETER"),
        (["mod"], [1.0], "UNKNOWN_PARAMETER"),
        (["mood"], [math.nan], "NOT_FINITE"),
        (["mood"], [math.inf], "NOT_FINITE"),
        (["mood"], [0.99], "OUT_OF_RANGE"),
        (["mood"], [5.01], "OUT_OF_RANGE"),
    ],
)
def test_invalid_given_values_are_rejected_with_code(names, values, code):
    with pytest.raises(Refused, match=f"^{code}:"):
        check_given(SPACE, names, values)


def run(number: int, epoch: str = "e") -> LiveRun:
    return LiveRun(epoch=epoch, round=number, scene_id=f"s{number}")


def test_run_is_live_from_start_to_end():
    following = RunTracker()
    assert following.started(run(1))
    assert following.run == run(1)
    following.ended("e", 1)
    assert following.run is None


def test_end_of_another_run_ends_nothing():
    following = RunTracker()
    following.started(run(2))
    following.ended("e", 1)
    following.ended("other", 2)
    assert following.run == run(2)


def test_start_arriving_after_its_end_starts_nothing():
    following = RunTracker()
    following.ended("e", 1)
    assert not following.started(run(1))
    assert following.started(run(2))


def test_start_older_than_market_round_starts_nothing():
    following = RunTracker()
    following.market("e", 3, idle=True)
    assert not following.started(run(2))
    assert not following.started(run(3)), "idle: the last round is over"
    assert following.started(run(4)), "its status may be on the way"
    following.market("e", 4, idle=False)
    assert following.run == run(4)


def test_restarted_market_ends_earlier_runs():
    following = RunTracker()
    following.started(run(1))
    following.market("new", 0, idle=True)
    assert following.run is None
