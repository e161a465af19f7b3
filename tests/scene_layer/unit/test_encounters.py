# SPDX-License-Identifier: Apache-2.0
"""Scenes of persons with ids: separate values, and gaps filled from memory."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.scene import Origin, Scene, SceneValue
from bt_agents_language.model.scene_specs import SceneSpec
from file_texts import read_scene_text
from plain_message import message_of
from scene_layer.memory import MOST_KNOWN, Memory, from_text, to_text
from scene_layer.persons import AWAY_S, MOST_AWAY
from scene_layer.scene_estimator import SceneEstimator
from scene_layer.sources import Sources

FACES = """
format: 1
parameters:
  age: {min: 1, max: 5, default: 3, description: how old, missing: default}
  mood: {min: 1, max: 5, default: 3, description: how it feels, missing: estimate}
  height: {min: 0, max: 3, default: 1.7, description: how tall}
  noise: {min: 0, max: 10, default: 0, description: how loud it is here}
mood: mood
place: lobby
no_person: {mood: 3}
persons:
  tracked:
    topic: faces
    type: bt_agents_interfaces/msg/Faces
    field: faces
    id: face_id
    stale_after: 5 s
    lost_after: 0 s
  known: {from: tracked, field: known}
  addressee: {rule: nearest, source: {from: tracked, field: distance_m}, for: 1 s}
sources:
  age: {from: tracked, field: age, std: age_std, stale_after: 2 s}
  mood: {from: tracked, field: mood, confidence: sure, stale_after: 2 s}
  height: {from: tracked, field: height, stale_after: 2 s}
  noise: {topic: noise, type: std_msgs/msg/Float64, field: data, stale_after: 60 s}
"""
SPEC = read_scene_text(FACES, "scene.yaml")
assert SPEC.persons is not None
MOOD = "{from: tracked, field: mood, confidence: sure, stale_after: 2 s}"
VOICE = "{topic: voice, type: std_msgs/msg/Float64, field: data, stale_after: 60 s}"
BOTH = read_scene_text(FACES.replace(MOOD, f"[{MOOD}, {VOICE}]"), "scene.yaml")
IGNORANCE = 4 / math.sqrt(12)


class EncounterHarness:
    """Faces in front of a camera, second by second."""

    def __init__(self, memory: Memory | None = None, spec: SceneSpec = SPEC) -> None:
        self.spec = spec
        self.sources = Sources(spec)
        self.memory = memory or Memory(spec.space)
        self.estimate = SceneEstimator(spec, self.sources, self.memory)
        self.running: str | None = None
        self.now = 0.0

    def see(self, now: float, **faces: dict[str, float]) -> None:
        """Take a picture; values that a face lacks are not in its item."""
        self.now = now
        crowd = self.estimate.encounters.persons
        crowd.receive_ids(list(faces), now)
        for person in crowd.candidates:
            if person in faces:
                self.read(person, faces[person])
        self.look()

    def read(self, person: str, said: dict[str, float]) -> None:
        item = {"known": 0.0, "sure": 1.0, "age_std": 0.0} | said
        for source in self.spec.every_source:
            names = {name.removeprefix("msg.") for name in source.field.names}
            if source.of_item and names <= item.keys():
                self.sources.read(source, message_of(item), self.now, person)

    def hear(self, value: float, parameter: str = "noise") -> None:
        """Take a reading that belongs to no particular person."""
        of = (s for s in self.spec.sources if s.parameter == parameter and not s.per_person)
        self.sources.read(next(of), message_of({"data": value}), self.now)

    def look(self, now: float | None = None) -> bool:
        self.now = self.now if now is None else now
        return self.estimate.update(self.now, 1000.0 + self.now, self.running)

    def announce(self, scene_id: str = "s", person: bool | None = None, **given: float) -> Scene:
        self.estimate.begin(scene_id, "", given, person, self.now)
        return self.scene(scene_id)

    def scene(self, scene_id: str = "s") -> Scene:
        return self.estimate.scene(scene_id, now=self.now, wall=1000.0 + self.now, stamp=0.0)

    def value(self, name: str, scene_id: str = "s") -> SceneValue:
        [value] = [v for v in self.scene(scene_id).values if v.name == name]
        return value


@pytest.fixture
def harness() -> EncounterHarness:
    return EncounterHarness()


def words(scene: Scene) -> list[str]:
    return [
        v.name if v.origin is Origin.MISSING else f"{v.name} {v.origin.name.lower()} {v.value:g}"
        for v in scene.values
    ]


def test_scene_has_values_of_the_addressee(harness):
    anna, ben = {"age": 4.0, "mood": 2.0, "distance_m": 1.0}, {"age": 1.0, "distance_m": 2.0}
    harness.see(0.0, ben=ben, anna=anna)
    harness.hear(7.0)
    scene = harness.announce()
    assert (scene.person, scene.person_id, scene.place, scene.persons) == (
        True,
        "anna",
        "lobby",
        2,
    )
    assert words(scene) == ["age measured 4", "mood measured 2", "height", "noise measured 7"]
    of_ben = harness.estimate.scene_of("ben", now=0.0, wall=1000.0, stamp=0.0)
    assert (of_ben.person, of_ben.person_id, of_ben.scene_id) == (True, "ben", "person/ben")
    assert words(of_ben) == ["age measured 1", "mood", "height", "noise measured 7"]


def test_scene_without_person_is_separate(harness):
    harness.hear(7.0)
    scene = harness.announce()
    assert (scene.person, scene.person_id, scene.persons) == (False, "", 0)
    assert words(scene) == ["age", "mood default 3", "height", "noise measured 7"]
    assert harness.value("mood").source == "nobody is there"


def test_scene_declared_without_person_ignores_passers_by(harness):
    harness.see(0.0, anna={"age": 4.0})
    scene = harness.announce(person=False, mood=1.0)
    assert (scene.person, scene.person_id) == (False, "")
    assert words(scene) == ["age", "mood given 1", "height", "noise"]
    harness.see(1.0, anna={"age": 4.0})
    assert not harness.scene().person


def test_unmeasured_value_of_stranger_is_missing_or_default(harness):
    harness.see(0.0, anna={"height": 1.6})
    harness.announce()
    assert words(harness.scene()) == ["age default 3", "mood", "height measured 1.6", "noise"]
    age = harness.value("age")
    assert (age.std, age.confidence, age.source) == (pytest.approx(IGNORANCE), 0.0, "default")


def test_stale_value_is_estimated_with_growing_uncertainty(harness):
    for second in range(10):
        harness.see(float(second), anna={"age": 4.0, "mood": 2.0, "height": 1.6})
    harness.announce()
    assert words(harness.scene()) == [
        "age measured 4",
        "mood measured 2",
        "height measured 1.6",
        "noise",
    ]
    stds = []
    for second in (12.0, 60.0, 600.0, 6000.0):
        harness.see(second, anna={})
        assert words(harness.scene()) == ["age estimated 4", "mood estimated 2", "height", "noise"]
        stds.append(harness.value("age").std)
    assert stds == sorted(stds)
    assert 0.2 < stds[0] < 0.5 < stds[-1] < IGNORANCE
    age = harness.value("age")
    assert age.age_s == pytest.approx(5991.0)
    assert age.source == "anna, seen once"
    assert age.confidence == pytest.approx(1 - (age.std / IGNORANCE) ** 2)


def test_estimate_uncertainty_is_spread_of_measurements(harness):
    for second in range(100):
        harness.see(float(second), anna={"mood": 2.0 + 2.0 * (second % 2)})
    harness.announce()
    harness.see(110.0, anna={})
    mood = harness.value("mood")
    assert mood.value == pytest.approx(3.0, abs=0.01)
    assert mood.std == pytest.approx(1.0, abs=0.02)


def test_known_person_is_remembered_and_stranger_is_not(harness):
    for second in range(3):
        harness.see(
            float(second), anna={"age": 5.0, "known": 1.0}, face7={"age": 1.0, "known": 0.0}
        )
    harness.see(3.0)
    harness.see(400.0, anna={"known": 1.0})
    harness.announce()
    assert harness.value("age").value == 5.0
    assert harness.value("age").source == "anna, seen 2 times"
    harness.see(500.0)
    harness.see(900.0, face7={})
    harness.announce("t")
    age = harness.value("age", "t")
    assert age.source == "everybody in lobby, 2 visits"
    assert age.value == pytest.approx(3.0, abs=0.05)


def test_each_visit_counts_once_in_place_average(harness):
    for number in range(4):
        for second in range(50 if number else 1):
            harness.see(
                100.0 * number + second, **{f"face{number}": {"age": 1.0 if number else 5.0}}
            )
        harness.see(100.0 * number + 60)
    harness.see(1000.0, face9={})
    harness.announce()
    assert harness.value("age").value == pytest.approx(2.0, abs=0.05)


def test_estimated_and_given_values_are_not_remembered(harness):
    harness.see(0.0, anna={"known": 1.0})
    harness.announce(age=5.0, mood=1.0)
    for second in range(1, 10):
        harness.see(float(second), anna={"known": 1.0})
        harness.scene()
    harness.see(20.0)
    assert harness.memory.snapshot() == ({}, {})


def test_reading_without_confidence_is_ignored(harness):
    harness.see(0.0, anna={"mood": 1.0, "sure": 0.0})
    assert words(harness.announce())[1] == "mood"


def test_run_keeps_its_person_despite_nearer_one(harness):
    harness.see(0.0, anna={"mood": 4.0, "distance_m": 1.0})
    harness.announce()
    harness.running = "s"
    for second in range(1, 6):
        harness.see(
            float(second),
            anna={"mood": 4.0, "distance_m": 3.0},
            ben={"mood": 1.0, "distance_m": 0.5},
        )
    assert harness.estimate.encounters.persons.addressee == "ben"
    scene = harness.scene()
    assert (scene.person, scene.person_id) == (True, "anna")
    assert words(scene)[1] == "mood measured 4"
    assert harness.announce("t").person_id == "ben"


def test_run_with_lost_person_keeps_values_without_substitute(harness):
    for second in range(3):
        harness.see(float(second), anna={"age": 5.0, "mood": 4.0, "distance_m": 1.0})
    harness.announce()
    harness.running = "s"
    harness.see(3.0, ben={"age": 1.0, "mood": 1.0, "distance_m": 0.5})
    scene = harness.scene()
    assert (scene.person, scene.person_id, scene.persons) == (False, "anna", 1)
    assert words(scene)[:2] == ["age measured 5", "mood measured 4"]
    harness.see(10.0, ben={"age": 1.0, "mood": 1.0})
    assert words(harness.scene())[:2] == ["age estimated 5", "mood estimated 4"]
    assert not harness.scene().person
    harness.see(11.0, anna={"mood": 2.0}, ben={})
    assert (harness.scene().person, words(harness.scene())[1]) == (True, "mood measured 2")
    harness.see(12.0, ben={})
    harness.running = None
    harness.look(13.0)
    assert harness.memory.estimate("anna", "", "age", 1013.0) is None, "a stranger is forgotten"


def test_run_without_person_adopts_first_one_who_comes(harness):
    harness.announce()
    harness.running = "s"
    harness.see(1.0, anna={"mood": 4.0, "distance_m": 1.0})
    assert (harness.scene().person, harness.scene().person_id) == (True, "anna")
    harness.see(2.0, ben={"mood": 1.0, "distance_m": 0.2})
    harness.see(9.0, ben={"mood": 1.0, "distance_m": 0.2})
    assert (harness.scene().person, harness.scene().person_id) == (False, "anna")


def test_restarted_scene_layer_follows_person_of_run(harness):
    foreign = Scene(
        scene_id="s",
        label="",
        person=True,
        person_id="anna",
        values=tuple(SceneValue.missing(name) for name in SPEC.space.names),
    )
    harness.see(0.0, ben={"mood": 1.0, "distance_m": 0.1}, anna={"mood": 4.0, "distance_m": 2.0})
    harness.estimate.adopt(foreign, 0.0)
    harness.running = "s"
    harness.see(1.0, ben={"mood": 1.0}, anna={"mood": 4.0})
    assert (harness.scene().person_id, words(harness.scene())[1]) == ("anna", "mood measured 4")


def test_given_value_lasts_until_newer_measurement_of_person(harness):
    harness.see(0.0, anna={"mood": 4.0, "distance_m": 1.0}, ben={"mood": 5.0, "distance_m": 2.0})
    harness.announce(mood=1.0)
    harness.see(1.0, anna={}, ben={"mood": 5.0})
    assert words(harness.scene())[1] == "mood given 1"
    harness.see(2.0, anna={"mood": 3.0}, ben={"mood": 5.0})
    assert words(harness.scene())[1] == "mood measured 3"


def test_current_scene_follows_the_addressee(harness):
    harness.see(0.0, anna={"distance_m": 1.0})
    harness.estimate.give("", {}, None, 0.0)
    assert harness.scene("").person_id == "anna"
    harness.see(5.0, ben={"distance_m": 1.0})
    assert harness.scene("").person_id == "ben"
    harness.see(9.0)
    assert words(harness.scene(""))[:2] == ["age", "mood default 3"], (
        "nobody is a scene of its own"
    )


# --- one person at a time, without ids -------------------------------------------------------

ONE = read_scene_text(
    """
format: 1
parameters: {age: {min: 1, max: 5, default: 3, description: how old, missing: estimate}}
sources:
  person: {topic: there, type: std_msgs/msg/Bool, field: data, stale_after: 60 s}
  age: {topic: age, type: std_msgs/msg/Float64, field: data, stale_after: 2 s}
""",
    "scene.yaml",
)


class Door:
    """Persons who come through a door, one at a time."""

    def __init__(self) -> None:
        self.sources = Sources(ONE)
        self.estimate = SceneEstimator(ONE, self.sources, Memory(ONE.space))
        self.running: str | None = None
        self.estimate.begin("s", "", {}, None, 0.0)

    def at(self, now: float, *, there: bool, age: float | None = None) -> str:
        """Return the age in the scene after some readings."""
        assert ONE.person is not None
        self.sources.read(ONE.person, message_of({"data": there}), now)
        if age is not None:
            self.sources.read(ONE.sources[0], message_of({"data": age}), now)
        self.estimate.update(now, now, self.running)
        [value] = self.estimate.scene("s", now=now, wall=now, stamp=0.0).values
        return f"{value.origin.name.lower()} {value.value:.3g} {value.source}".strip()


def test_values_without_ids_do_not_pass_between_persons():
    door = Door()
    assert door.at(0.0, there=True, age=5.0) == "measured 5 age"
    assert door.at(10.0, there=True) == "estimated 5 this person, seen once"
    assert door.at(11.0, there=False) == "estimated 5 everybody here, 1 visit"
    assert door.at(12.0, there=True) == "estimated 5 everybody here, 1 visit"
    assert door.at(13.0, there=True, age=1.0) == "measured 1 age"
    assert door.at(20.0, there=True) == "estimated 1 this person, seen once"
    assert door.at(21.0, there=False).startswith("estimated 2.99 everybody here, 2 visits")


def test_run_without_ids_keeps_values_of_departed_person():
    door = Door()
    door.at(0.0, there=True, age=5.0)
    door.running = "s"
    door.at(1.0, there=True)
    assert door.at(10.0, there=False) == "estimated 5 this person, seen once"
    door.running = None
    assert door.at(11.0, there=False) == "estimated 5 everybody here, 1 visit"


# --- forgetting -----------------------------------------------------------------------------


def test_forgotten_person_is_unknown_until_next_visit(harness):
    for second in range(3):
        harness.see(float(second), anna={"age": 5.0, "known": 1.0})
    assert harness.memory.forget(person="anna")
    assert not harness.memory.forget(person="anna")
    for second in range(3, 6):
        harness.see(float(second), anna={"age": 5.0, "known": 1.0})
    harness.see(6.0)
    assert harness.memory.snapshot()[0] == {}, "not remembered from the rest of this visit either"
    harness.see(400.0, anna={"age": 4.0, "known": 1.0})
    harness.see(401.0)
    assert set(harness.memory.snapshot(harness.estimate.encounters.known)[0]) == {"anna"}


def test_place_can_be_forgotten(harness):
    harness.see(0.0, face1={"age": 5.0})
    harness.see(1.0)
    assert harness.memory.forget(place="lobby")
    assert harness.memory.snapshot() == ({}, {})


def test_person_not_seen_longest_is_forgotten_first():
    memory = Memory(SPEC.space)
    for number in range(MOST_KNOWN + 10):
        person = f"p{number}"
        memory.came(person, float(number))
        memory.measured(person, "age", 3.0, 0.0, 1.0, float(number))
        memory.left(person, f"place {number}", known=True, now=float(number))
    persons, places = memory.snapshot()
    assert len(persons) == len(places) == MOST_KNOWN
    assert "p9" not in persons
    assert "p10" in persons


# --- state that survives a restart --------------------------------------------------------


def test_only_known_persons_survive_restart(harness):
    for second in range(3):
        harness.see(float(second), anna={"age": 5.0, "known": 1.0}, face7={"age": 1.0})
    text = to_text(*harness.memory.snapshot(harness.estimate.encounters.known))
    persons, places = from_text(text, SPEC.space, 1e9)
    assert set(persons) == {"anna"}
    assert places == {}
    memory = Memory(SPEC.space)
    memory.restore(persons, places)
    again = EncounterHarness(memory)
    again.see(0.0, anna={})
    again.announce()
    assert again.value("age").value == 5.0
    assert again.value("age").source == "anna, seen 2 times"


def test_ids_gone_between_two_updates_leave_no_data(harness):
    sources = harness.sources
    for picture in range(40):
        harness.estimate.encounters.persons.receive_ids([f"face{picture}"], 0.01 * picture)
        harness.read(f"face{picture}", {"age": 3.0})
    harness.look(0.5)
    assert sources.people == {"face39"}, "only who is listed still"
    harness.see(1.0)
    harness.see(9.0)
    assert sources.people == frozenset()


def test_short_tracking_gaps_create_no_new_visits(harness):
    for second in range(0, 120, 2):
        harness.see(float(second), anna={"age": 5.0, "known": 1.0})
        harness.see(second + 1.0)
    for second in (120, 122):
        harness.see(float(second), face7={"age": 1.0})
        harness.see(second + 1.0)
    assert harness.estimate.encounters.known == {"anna"}
    persons, places = harness.memory.snapshot(harness.estimate.encounters.known)
    assert (set(persons), persons["anna"].visits) == ({"anna"}, 1)
    assert places["lobby"].visits == 2
    harness.look(119.0 + AWAY_S)
    persons, places = harness.memory.snapshot()
    assert places["lobby"].visits == 3
    assert persons["anna"].seen_at == 1119.0, "when they went, not when that was certain"


def test_persons_out_of_sight_longest_leave_first(harness):
    for number in range(MOST_AWAY + 10):
        harness.see(float(number), **{f"anna{number}": {"age": 5.0, "known": 1.0}})
    harness.see(100.0)
    assert len(harness.sources.people) == MOST_AWAY
    assert harness.memory.snapshot()[1]["lobby"].visits == 10


def test_only_personal_readings_count_for_lost_person():
    harness = EncounterHarness(spec=BOTH)
    harness.see(0.0, anna={"mood": 5.0})
    harness.announce()
    harness.running = "s"
    harness.hear(1.0, "mood")
    assert harness.value("mood").value == 3.0, "the face and the room"
    harness.see(1.0)
    assert not harness.scene().person
    assert harness.value("mood").value == 5.0
    harness.hear(1.0, "mood")
    harness.look(3.0)
    assert harness.value("mood").origin is not Origin.MEASURED


def test_room_reading_alone_is_not_a_personal_mood():
    harness = EncounterHarness(spec=BOTH)
    harness.see(0.0, anna={"known": 1.0})
    harness.hear(1.0, "mood")
    harness.announce()
    assert harness.value("mood").origin is Origin.MISSING
    harness.see(1.0, anna={"known": 1.0, "mood": 5.0})
    assert harness.value("mood").value == 3.0
    harness.see(2.0, anna={"known": 1.0, "mood": 5.0})
    assert harness.memory.snapshot({"anna"})[0]["anna"].values["mood"].mean == 5.0


def test_measurements_count_at_most_once_per_second(harness):
    for picture in range(61):
        harness.see(picture / 30.0, anna={"age": 5.0})
    assert harness.memory._persons["anna"].values["age"].weight == pytest.approx(
        1 + 0.99 + 0.99**2
    )
    before = harness.memory._persons["anna"].values["age"]
    for second in (2.9, 3.2, 3.9):
        harness.look(second)
    assert harness.memory._persons["anna"].values["age"] is before
