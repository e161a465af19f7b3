# SPDX-License-Identifier: Apache-2.0
"""Persons who are known by name: their visits, what is remembered of them, what is theirs."""

from __future__ import annotations

import json
from collections.abc import Mapping

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Origin, Scene
from bt_agents_language.model.scene_specs import SceneSpec
from file_texts import read_scene_text
from plain_message import message_of
from scene_layer.memory import DamagedMemoryError, Memory, from_text, to_text
from scene_layer.persons import AWAY_S
from scene_layer.scene_estimator import SceneEstimator
from scene_layer.sources import Sources

PARAMETERS = """
format: 1
parameters:
  pain: {min: 0, max: 10, default: 0, of: person}
  noise: {min: 0, max: 10, default: 0}
remembers: {favourite: text, cups: number}
"""
WITH_IDS = f"""{PARAMETERS}
persons:
  tracked:
    topic: faces
    type: bt_agents_interfaces/msg/Faces
    field: faces
    id: face_id
    stale_after: 999 s
    lost_after: 0 s
  known: {{from: tracked, field: known}}
  addressee: {{rule: nearest, source: {{from: tracked, field: distance_m}}, for: 0 s}}
sources:
  pain: {{from: tracked, field: mood, stale_after: 5 s}}
"""
WITHOUT_IDS = f"""{PARAMETERS}
sources:
  person: {{topic: person, type: std_msgs/msg/Bool, field: data, stale_after: 999 s}}
"""


class Room:
    """A scene layer without ROS."""

    def __init__(self, text: str = WITH_IDS, memory: Memory | None = None) -> None:
        self.spec: SceneSpec = read_scene_text(text, "scene.yaml")
        self.sources = Sources(self.spec)
        self.memory = memory or Memory(self.spec.space)
        self.estimate = SceneEstimator(self.spec, self.sources, self.memory)
        self.running: str | None = None
        self.now = 0.0

    def see(self, now: float, *known: str, strangers: tuple[str, ...] = ()) -> None:
        """Take a picture; who is named first is nearest."""
        self.now = now
        self.estimate.encounters.persons.receive_ids([*known, *strangers], now)
        for number, person in enumerate((*known, *strangers)):
            self.read(person, {"known": person in known, "distance_m": 1.0 + number})
        self.update()

    def read(self, person: str, item: Mapping[str, float]) -> None:
        for source in self.spec.every_source:
            if {name.removeprefix("msg.") for name in source.field.names} <= item.keys():
                self.sources.read(source, message_of(dict(item)), self.now, person)

    def somebody(self, now: float, there: bool) -> None:
        """Measure whether somebody is there, where persons have no ids."""
        self.now = now
        assert self.spec.person is not None
        self.sources.read(self.spec.person, message_of({"data": there}), now)
        self.update()

    def update(self) -> None:
        self.estimate.update(self.now, 1000.0 + self.now, self.running)

    def begin(self, scene_id: str, **values: float) -> Scene:
        self.estimate.begin(scene_id, "", values, None, self.now)
        return self.scene(scene_id)

    def give(self, scene_id: str, told: bool = True, **values: float) -> None:
        self.estimate.give(scene_id, values, None, self.now, told=told)

    def scene(self, scene_id: str = "s") -> Scene:
        return self.estimate.scene(scene_id, now=self.now, wall=1000.0 + self.now, stamp=0.0)

    def remember(self, person: str, **values: object) -> None:
        self.memory.remember(person, values.items(), known=self.estimate.encounters.known)

    def pain(self, scene_id: str = "s") -> str:
        value = self.scene(scene_id).values[0]
        if value.origin is Origin.MISSING:
            return "missing"
        return f"{value.origin.name.lower()} {value.value:g}"


def refusal(room: Room, person: str, **values: object) -> str:
    with pytest.raises(Refused) as refused:
        room.remember(person, **values)
    return refused.value.code


def test_visits_are_counted_only_for_known_persons() -> None:
    room = Room()
    room.see(0.0, "anna")
    assert (room.begin("s").person_id, room.scene().visits) == ("anna", 1)
    room.see(1.0)
    room.see(2.0 + AWAY_S)
    room.see(3.0 + AWAY_S, "anna")
    assert room.begin("t").visits == 2
    room.see(4.0 + AWAY_S, strangers=("7",))
    assert (room.begin("u").person_id, room.scene("u").visits) == ("7", 0)


def test_short_absence_is_part_of_same_visit() -> None:
    room = Room()
    room.see(0.0, "anna")
    room.see(1.0)
    room.see(2.0, "anna")
    assert room.begin("s").visits == 1


def test_remembered_values_appear_in_current_and_later_visits() -> None:
    room = Room()
    room.see(0.0, "anna", "ben")
    room.remember("anna", favourite="tea", cups=2)
    assert room.begin("s").remembered == {"favourite": "tea", "cups": 2.0}
    room.remember("anna", favourite="water", cups=None)
    assert room.scene().remembered == {"favourite": "water"}
    ben = room.estimate.scene_of("ben", now=0.0, wall=0.0, stamp=0.0)
    assert (ben.visits, ben.remembered) == (1, {})
    room.see(1.0)
    room.see(2.0 + AWAY_S, "anna")
    assert room.begin("t").remembered == {"favourite": "water"}


def test_invalid_remember_request_is_rejected_without_change() -> None:
    room = Room()
    room.see(0.0, "anna", strangers=("7",))
    assert refusal(room, "7", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(room, "nobody", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(room, "", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(room, "anna", favorite="tea") == "BAD_KEY"
    assert refusal(room, "anna", favourite="tea", cups="two") == "BAD_VALUE"
    assert room.begin("s").remembered == {}


def test_forgetting_person_drops_remembered_values_until_they_return() -> None:
    room = Room()
    room.see(0.0, "anna")
    room.remember("anna", favourite="tea")
    assert room.memory.forget(person="anna")
    assert room.begin("s").remembered == {}
    assert refusal(room, "anna", favourite="tea") == "FORGOTTEN"
    persons, _ = room.memory.snapshot(room.estimate.encounters.known)
    assert "anna" not in persons


def test_absent_person_is_remembered_across_restart() -> None:
    room = Room()
    room.see(0.0, "anna", strangers=("7",))
    room.remember("anna", favourite="tea", cups=1)
    room.see(1.0)
    room.see(2.0 + AWAY_S)
    room.remember("anna", cups=3)
    text = to_text(*room.memory.snapshot())
    assert '"7"' not in text
    again = Memory(room.spec.space)
    again.restore(*from_text(text, room.spec.space, 5000.0))
    later = Room(memory=again)
    later.see(0.0, "anna")
    scene = later.begin("s")
    assert (scene.visits, scene.remembered) == (2, {"favourite": "tea", "cups": 3.0})


def test_memory_file_holds_only_values_declared_in_scene() -> None:
    space = Room().spec.space
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


def test_told_value_lasts_until_newer_measurement() -> None:
    room = Room()
    room.see(0.0, "anna")
    room.begin("s")
    room.give("s", pain=8.0, noise=3.0)
    values = room.scene().values
    assert [(one.origin, one.value, one.source) for one in values] == [
        (Origin.TOLD, 8.0, "the person"),
        (Origin.TOLD, 3.0, "the person"),
    ]
    assert room.scene().observed == (8.0, 3.0)
    room.now = 1.0
    room.read("anna", {"mood": 5.0})
    assert room.pain() == "measured 5"


def test_personal_value_persists_across_interactions_unlike_scene_value() -> None:
    room = Room()
    room.see(0.0, "anna")
    room.begin("s")
    room.give("s", pain=8.0, noise=3.0)
    room.see(1.0, "anna")
    later = room.begin("t")
    assert [one.origin for one in later.values] == [Origin.TOLD, Origin.MISSING]


def test_personal_value_is_forgotten_when_person_leaves() -> None:
    room = Room()
    room.see(0.0, "anna")
    room.begin("s")
    room.give("s", told=False, pain=8.0)
    room.running = "s"
    assert room.pain() == "given 8"
    room.see(1.0)
    assert room.pain() == "missing"
    room.see(2.0, "anna")
    assert room.pain() == "missing"


def test_personal_value_does_not_pass_to_next_addressee() -> None:
    room = Room()
    room.see(0.0, "anna", "ben")
    room.begin("s")
    room.give("s", pain=8.0)
    room.see(1.0, "ben", "anna")
    assert room.begin("t").person_id == "ben"
    assert room.pain("t") == "missing"
    assert room.pain("s") == "told 8"


def test_value_without_ids_lasts_until_no_person_present() -> None:
    room = Room(WITHOUT_IDS)
    room.somebody(0.0, True)
    room.begin("s")
    room.give("s", pain=8.0, noise=1.0)
    room.somebody(1.0, True)
    assert [one.origin for one in room.begin("t").values] == [Origin.TOLD, Origin.MISSING]
    room.somebody(2.0, False)
    assert room.pain("t") == "missing"
    room.somebody(3.0, True)
    assert room.begin("u").values[0].origin is Origin.MISSING


def test_value_without_measured_person_belongs_to_its_interaction() -> None:
    room = Room(WITHOUT_IDS)
    room.estimate.begin("s", "", {"pain": 8.0}, True, 0.0)
    assert room.pain() == "given 8"
    assert room.begin("t").values[0].origin is Origin.MISSING
    room.estimate.give("s", {}, False, 1.0)
    assert room.pain() == "missing"


def test_told_value_of_adopted_scene_stays_told() -> None:
    room = Room()
    room.see(0.0, "anna")
    room.begin("s")
    room.give("s", noise=3.0)
    other = Room()
    other.see(0.0, "anna")
    other.estimate.adopt(room.scene("s"), 0.0)
    assert other.scene("s").values[1].origin is Origin.TOLD


def test_scripted_person_is_known_until_next_visit() -> None:
    room = Room(WITHOUT_IDS)
    begin = room.estimate.encounters.begin_visit
    for now, visitor, visits, remembered in (
        (0.0, "anna", 1, {}),
        (1.0, "", 0, {}),
        (2.0, "anna", 2, {"favourite": "tea"}),
        (3.0, "anna", 3, {"favourite": "tea"}),
    ):
        begin(visitor, now, 1000.0 + now)
        scene_id = f"s{now:g}"
        room.estimate.begin(scene_id, "", {}, True, now, person_id=visitor or None)
        scene = room.scene(scene_id)
        assert (scene.person_id, scene.visits, scene.remembered) == (visitor, visits, remembered)
        if visits == 1:
            room.remember("anna", favourite="tea")
