# SPDX-License-Identifier: Apache-2.0
"""Scenes of persons with ids: separate values, and gaps filled from memory."""

from __future__ import annotations

import json
import math

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Origin, Scene, SceneValue
from file_texts import read_scene_text
from scene_layer.memory import MOST_KNOWN, DamagedMemoryError, Memory, from_text, to_text
from scene_layer.persons import AWAY_S, MOST_AWAY
from scene_layer_harness import SceneLayerHarness, words

TRACKED = "topic: faces, type: bt_agents_interfaces/msg/Faces, field: faces, id: face_id"
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
  tracked: {TRACKED, stale_after: 5 s, lost_after: 0 s}
  known: {from: tracked, field: known}
  addressee: {rule: nearest, source: {from: tracked, field: distance_m}, for: 1 s}
sources:
  age: {from: tracked, field: age, std: age_std, stale_after: 2 s}
  mood: {from: tracked, field: mood, confidence: sure, stale_after: 2 s}
  height: {from: tracked, field: height, stale_after: 2 s}
  noise: {topic: noise, type: std_msgs/msg/Float64, field: data, stale_after: 60 s}
""".replace("TRACKED", TRACKED)
SPEC = read_scene_text(FACES, "scene.yaml")
MOOD = "{from: tracked, field: mood, confidence: sure, stale_after: 2 s}"
VOICE = "{topic: voice, type: std_msgs/msg/Float64, field: data, stale_after: 60 s}"
BOTH = read_scene_text(FACES.replace(MOOD, f"[{MOOD}, {VOICE}]"), "scene.yaml")
IGNORANCE = 4 / math.sqrt(12)


@pytest.fixture
def harness() -> SceneLayerHarness:
    return SceneLayerHarness(SPEC)


def test_scene_has_values_of_the_addressee(harness):
    anna, ben = {"age": 4.0, "mood": 2.0, "distance_m": 1.0}, {"age": 1.0, "distance_m": 2.0}
    harness.see(0.0, ben=ben, anna=anna)
    harness.hear(7.0)
    scene = harness.announce()
    found = (scene.person, scene.person_id, scene.place, scene.persons)
    assert found == (True, "anna", "lobby", 2)
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
    harness.watch(range(10), anna={"age": 4.0, "mood": 2.0, "height": 1.6})
    measured = ["age measured 4", "mood measured 2", "height measured 1.6", "noise"]
    assert words(harness.announce()) == measured
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


def test_known_person_is_remembered_and_stranger_is_not(harness):
    harness.watch(range(3), anna={"age": 5.0, "known": 1.0}, face7={"age": 1.0, "known": 0.0})
    harness.see(3.0)
    harness.see(400.0, anna={"known": 1.0})
    harness.announce()
    age = harness.value("age")
    assert (age.value, age.source) == (5.0, "anna, seen 2 times")
    harness.see(500.0)
    harness.see(900.0, face7={})
    harness.announce("t")
    age = harness.value("age", "t")
    assert age.source == "everybody in lobby, 2 visits"
    assert age.value == pytest.approx(3.0, abs=0.05)


def test_each_visit_counts_once_in_place_average(harness):
    harness.see(0.0, face0={"age": 5.0})
    harness.see(60.0)
    for number in range(1, 4):
        seconds = range(100 * number, 100 * number + 50)
        harness.watch(seconds, **{f"face{number}": {"age": 1.0}})
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


def test_run_keeps_its_person_despite_nearer_one(harness):
    harness.see(0.0, anna={"mood": 4.0, "distance_m": 1.0})
    harness.announce()
    harness.running = "s"
    ben = {"mood": 1.0, "distance_m": 0.5}
    harness.watch(range(1, 6), anna={"mood": 4.0, "distance_m": 3.0}, ben=ben)
    assert harness.estimate.encounters.persons.addressee == "ben"
    scene = harness.scene()
    assert (scene.person, scene.person_id, words(scene)[1]) == (True, "anna", "mood measured 4")
    assert harness.announce("t").person_id == "ben"


def test_run_with_lost_person_keeps_values_without_substitute(harness):
    harness.watch(range(3), anna={"age": 5.0, "mood": 4.0, "distance_m": 1.0})
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
    missing = tuple(SceneValue.missing(name) for name in SPEC.space.names)
    foreign = Scene(scene_id="s", label="", person=True, person_id="anna", values=missing)
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
    nobody = words(harness.scene(""))[:2]
    assert nobody == ["age", "mood default 3"], "nobody is a scene of its own"


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


class Door(SceneLayerHarness):
    """Persons who come through a door, one at a time."""

    def at(self, now: float, *, there: bool, age: float | None = None) -> str:
        """Return the age in the scene after some readings."""
        self.hear(there, "person", now)
        if age is not None:
            self.hear(age, "age")
        self.look()
        value = self.value("age")
        return f"{value.origin.name.lower()} {value.value:.3g} {value.source}"


@pytest.fixture
def door() -> Door:
    door = Door(ONE)
    door.announce()
    return door


def test_values_without_ids_do_not_pass_between_persons(door):
    assert door.at(0.0, there=True, age=5.0) == "measured 5 age"
    assert door.at(10.0, there=True) == "estimated 5 this person, seen once"
    assert door.at(11.0, there=False) == "estimated 5 everybody here, 1 visit"
    assert door.at(12.0, there=True) == "estimated 5 everybody here, 1 visit"
    assert door.at(13.0, there=True, age=1.0) == "measured 1 age"
    assert door.at(20.0, there=True) == "estimated 1 this person, seen once"
    assert door.at(21.0, there=False).startswith("estimated 2.99 everybody here, 2 visits")


def test_run_without_ids_keeps_values_of_departed_person(door):
    door.at(0.0, there=True, age=5.0)
    door.running = "s"
    door.at(1.0, there=True)
    assert door.at(10.0, there=False) == "estimated 5 this person, seen once"
    door.running = None
    assert door.at(11.0, there=False) == "estimated 5 everybody here, 1 visit"


# --- forgetting -----------------------------------------------------------------------------


def test_forgotten_person_is_unknown_until_next_visit(harness):
    harness.watch(range(3), anna={"age": 5.0, "known": 1.0})
    assert harness.memory.forget(person="anna")
    assert not harness.memory.forget(person="anna")
    harness.watch(range(3, 6), anna={"age": 5.0, "known": 1.0})
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


def test_ids_gone_between_two_updates_leave_no_data(harness):
    for picture in range(40):
        harness.estimate.encounters.persons.receive_ids([f"face{picture}"], 0.01 * picture)
        harness.read(f"face{picture}", {"age": 3.0, "age_std": 0.0})
    harness.look(0.5)
    assert harness.sources.people == {"face39"}, "only who is listed still"
    harness.see(1.0)
    harness.see(9.0)
    assert harness.sources.people == frozenset()


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
    harness = SceneLayerHarness(BOTH)
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
    harness = SceneLayerHarness(BOTH)
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
    before = harness.memory._persons["anna"].values["age"]
    assert before.weight == pytest.approx(1 + 0.99 + 0.99**2)
    for second in (2.9, 3.2, 3.9):
        harness.look(second)
    assert harness.memory._persons["anna"].values["age"] is before


# Persons known by name: their visits, remembered facts, and own values
PARAMETERS = """
format: 1
parameters:
  pain: {min: 0, max: 10, default: 0, of: person}
  noise: {min: 0, max: 10, default: 0}
remembers: {favourite: text, cups: number}
"""
WITH_IDS = f"""{PARAMETERS}
persons:
  tracked: {{{TRACKED}, stale_after: 999 s, lost_after: 0 s}}
  known: {{from: tracked, field: known}}
  addressee: {{rule: nearest, source: {{from: tracked, field: distance_m}}, for: 0 s}}
sources:
  pain: {{from: tracked, field: mood, stale_after: 5 s}}
"""
WITHOUT_IDS = f"""{PARAMETERS}
sources:
  person: {{topic: person, type: std_msgs/msg/Bool, field: data, stale_after: 999 s}}
"""


class KnownPersonsHarness(SceneLayerHarness):
    """A scene layer with persons who are known by name, or none."""

    def __init__(self, text: str = WITH_IDS, memory: Memory | None = None) -> None:
        super().__init__(read_scene_text(text, "scene.yaml"), memory)

    def meet(self, now: float, *known: str, strangers: tuple[str, ...] = ()) -> None:
        """Take a picture; the person named first is nearest."""
        people = enumerate((*known, *strangers), 1)
        self.see(
            now, **{who: {"known": who in known, "distance_m": place} for place, who in people}
        )

    def somebody(self, now: float, there: bool) -> None:
        """Measure whether a person is present, without ids of persons."""
        self.hear(there, "person", now)
        self.look()

    def remember(self, person: str, **values: object) -> None:
        self.memory.remember(person, values.items(), known=self.estimate.encounters.known)

    def pain(self, scene_id: str = "s") -> str:
        return words(self.scene(scene_id))[0]


@pytest.fixture
def layer() -> KnownPersonsHarness:
    return KnownPersonsHarness()


def refusal(layer: KnownPersonsHarness, person: str, **values: object) -> str:
    with pytest.raises(Refused) as refused:
        layer.remember(person, **values)
    return refused.value.code


def test_visits_are_counted_only_for_known_persons(layer: KnownPersonsHarness) -> None:
    layer.meet(0.0, "anna")
    assert (layer.announce("s").person_id, layer.scene().visits) == ("anna", 1)
    layer.meet(1.0)
    layer.meet(2.0 + AWAY_S)
    layer.meet(3.0 + AWAY_S, "anna")
    assert layer.announce("t").visits == 2
    layer.meet(4.0 + AWAY_S, strangers=("7",))
    assert (layer.announce("u").person_id, layer.scene("u").visits) == ("7", 0)


def test_remembered_values_appear_in_current_and_later_visits(layer: KnownPersonsHarness) -> None:
    layer.meet(0.0, "anna", "ben")
    layer.remember("anna", favourite="tea", cups=2)
    assert layer.announce("s").remembered == {"favourite": "tea", "cups": 2.0}
    layer.remember("anna", favourite="water", cups=None)
    assert layer.scene().remembered == {"favourite": "water"}
    ben = layer.estimate.scene_of("ben", now=0.0, wall=0.0, stamp=0.0)
    assert (ben.visits, ben.remembered) == (1, {})
    layer.meet(1.0)
    layer.meet(2.0 + AWAY_S, "anna")
    assert layer.announce("t").remembered == {"favourite": "water"}


def test_invalid_remember_request_is_rejected_without_change(layer: KnownPersonsHarness) -> None:
    layer.meet(0.0, "anna", strangers=("7",))
    assert refusal(layer, "7", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(layer, "nobody", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(layer, "", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(layer, "anna", favorite="tea") == "BAD_KEY"
    assert refusal(layer, "anna", favourite="tea", cups="two") == "BAD_VALUE"
    assert layer.announce("s").remembered == {}


def test_forgetting_person_drops_remembered_values_until_they_return(
    layer: KnownPersonsHarness,
) -> None:
    layer.meet(0.0, "anna")
    layer.remember("anna", favourite="tea")
    assert layer.memory.forget(person="anna")
    assert layer.announce("s").remembered == {}
    assert refusal(layer, "anna", favourite="tea") == "FORGOTTEN"
    persons, _ = layer.memory.snapshot(layer.estimate.encounters.known)
    assert "anna" not in persons


def test_absent_person_is_remembered_across_restart(layer: KnownPersonsHarness) -> None:
    layer.meet(0.0, "anna", strangers=("7",))
    layer.remember("anna", favourite="tea", cups=1)
    layer.meet(1.0)
    layer.meet(2.0 + AWAY_S)
    layer.remember("anna", cups=3)
    text = to_text(*layer.memory.snapshot())
    assert '"7"' not in text
    again = Memory(layer.spec.space)
    again.restore(*from_text(text, layer.spec.space, 5000.0))
    later = KnownPersonsHarness(memory=again)
    later.meet(0.0, "anna")
    scene = later.announce("s")
    assert (scene.visits, scene.remembered) == (2, {"favourite": "tea", "cups": 3.0})


def test_unrecognised_moment_does_not_end_memory(layer: KnownPersonsHarness) -> None:
    layer.meet(0.0, "anna")
    layer.meet(1.0)
    layer.meet(2.0 + AWAY_S, "anna")
    layer.meet(4.0 + AWAY_S, strangers=("anna",))
    assert layer.estimate.encounters.known == frozenset()
    assert layer.memory.snapshot()[0]["anna"].visits == 2, "nor in the file meanwhile"
    layer.meet(5.0 + AWAY_S)
    assert layer.memory.snapshot()[0]["anna"].visits == 2


def test_memory_file_holds_only_values_declared_in_scene() -> None:
    space = KnownPersonsHarness().spec.space
    person = {"visits": 3, "seen_at": 1.0, "values": {}}

    def read(**remembers: object) -> object:
        document = {"anna": person | {"remembers": remembers}, "ben": person}
        text = json.dumps({"format": 1, "persons": document, "places": {}})
        persons, _ = from_text(text, space, 9.0)
        assert persons["ben"].facts == {}
        return persons["anna"].facts

    assert read(favourite="tea", cups="many", other=1) == {"favourite": "tea"}
    for bad in ({"favourite": ["tea"]}, {"favourite": "x" * 10_000}, {"Not a key": 1}):
        with pytest.raises(DamagedMemoryError):
            read(**bad)
    with pytest.raises(DamagedMemoryError):
        read(**{f"k{number}": 1 for number in range(33)})


def test_told_value_lasts_until_newer_measurement(layer: KnownPersonsHarness) -> None:
    layer.meet(0.0, "anna")
    layer.announce("s")
    layer.give(pain=8.0, noise=3.0)
    scene = layer.scene()
    assert words(scene) == ["pain told 8", "noise told 3"]
    assert ({one.source for one in scene.values}, scene.observed) == ({"the person"}, (8.0, 3.0))
    other = KnownPersonsHarness()
    other.meet(0.0, "anna")
    other.estimate.adopt(scene, 0.0)
    assert words(other.scene()) == words(scene)
    layer.meet(1.0, "anna")
    later = words(layer.announce("t"))
    assert later == ["pain told 8", "noise"], "only personal values last beyond an interaction"
    layer.read("anna", {"mood": 5.0})
    assert layer.pain() == "pain measured 5"


def test_personal_value_is_forgotten_when_person_leaves(layer: KnownPersonsHarness) -> None:
    layer.meet(0.0, "anna")
    layer.announce("s")
    layer.give(told=False, pain=8.0)
    layer.running = "s"
    assert layer.pain() == "pain given 8"
    layer.meet(1.0)
    assert layer.pain() == "pain"
    layer.meet(2.0, "anna")
    assert layer.pain() == "pain"


def test_personal_value_does_not_pass_to_next_addressee(layer: KnownPersonsHarness) -> None:
    layer.meet(0.0, "anna", "ben")
    layer.announce("s")
    layer.give(pain=8.0)
    layer.meet(1.0, "ben", "anna")
    assert layer.announce("t").person_id == "ben"
    assert (layer.pain("t"), layer.pain("s")) == ("pain", "pain told 8")


def test_value_without_ids_lasts_until_no_person_present() -> None:
    layer = KnownPersonsHarness(WITHOUT_IDS)
    layer.somebody(0.0, True)
    layer.announce("s")
    layer.give(pain=8.0, noise=1.0)
    layer.somebody(1.0, True)
    assert [one.origin for one in layer.announce("t").values] == [Origin.TOLD, Origin.MISSING]
    layer.somebody(2.0, False)
    assert layer.pain("t") == "pain"
    layer.somebody(3.0, True)
    assert layer.announce("u").values[0].origin is Origin.MISSING


def test_value_without_measured_person_belongs_to_its_interaction() -> None:
    layer = KnownPersonsHarness(WITHOUT_IDS)
    layer.estimate.begin("s", "", {"pain": 8.0}, True, 0.0)
    assert layer.pain() == "pain given 8"
    assert layer.announce("t").values[0].origin is Origin.MISSING
    layer.estimate.give("s", {}, False, 1.0)
    assert layer.pain() == "pain"


def test_scripted_person_is_known_until_next_visit() -> None:
    layer = KnownPersonsHarness(WITHOUT_IDS)
    begin = layer.estimate.encounters.begin_visit
    for now, visitor, visits, remembered in (
        (0.0, "anna", 1, {}),
        (1.0, "", 0, {}),
        (2.0, "anna", 2, {"favourite": "tea"}),
        (3.0, "anna", 3, {"favourite": "tea"}),
    ):
        begin(visitor, now, 1000.0 + now)
        scene_id = f"s{now:g}"
        layer.estimate.begin(scene_id, "", {}, True, now, person_id=visitor or None)
        scene = layer.scene(scene_id)
        assert (scene.person_id, scene.visits, scene.remembered) == (visitor, visits, remembered)
        if visits == 1:
            layer.remember("anna", favourite="tea")


def test_announced_person_stays_known_during_their_run(layer: KnownPersonsHarness) -> None:
    encounters = layer.estimate.encounters
    encounters.begin_visit("anna", 0.0, 1000.0)
    layer.estimate.begin("s", "", {}, True, 0.0, person_id="anna")
    layer.running = "s"
    encounters.begin_visit("ben", 1.0, 1001.0)
    layer.look(2.0 + AWAY_S)
    assert layer.scene().visits == 1
    layer.remember("anna", favourite="tea")
    assert layer.scene().remembered == {"favourite": "tea"}


def test_camera_continues_visit_of_announced_person(layer: KnownPersonsHarness) -> None:
    encounters = layer.estimate.encounters
    encounters.begin_visit("anna", 0.0, 1000.0)
    layer.meet(1.0, "anna")
    encounters.begin_visit("", 1.5, 1001.5)
    assert layer.announce("s").visits == 1
    layer.meet(2.0)
    encounters.begin_visit("anna", 3.0, 1003.0)
    layer.look(3.0 + AWAY_S)
    assert encounters.known == {"anna"}
    assert layer.memory.visits("anna") == 2
