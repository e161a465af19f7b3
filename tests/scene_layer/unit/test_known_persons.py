# SPDX-License-Identifier: Apache-2.0
"""Persons known by name: their visits, remembered facts, and own values."""

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


class KnownPersonsHarness:
    """A scene layer without ROS."""

    def __init__(self, text: str = WITH_IDS, memory: Memory | None = None) -> None:
        self.spec: SceneSpec = read_scene_text(text, "scene.yaml")
        self.sources = Sources(self.spec)
        self.memory = memory or Memory(self.spec.space)
        self.estimate = SceneEstimator(self.spec, self.sources, self.memory)
        self.running: str | None = None
        self.now = 0.0

    def see(self, now: float, *known: str, strangers: tuple[str, ...] = ()) -> None:
        """Take a picture; the person named first is nearest."""
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
        """Measure whether a person is present, without ids of persons."""
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


@pytest.fixture
def harness() -> KnownPersonsHarness:
    return KnownPersonsHarness()


def refusal(harness: KnownPersonsHarness, person: str, **values: object) -> str:
    with pytest.raises(Refused) as refused:
        harness.remember(person, **values)
    return refused.value.code


def test_visits_are_counted_only_for_known_persons(harness: KnownPersonsHarness) -> None:
    harness.see(0.0, "anna")
    assert (harness.begin("s").person_id, harness.scene().visits) == ("anna", 1)
    harness.see(1.0)
    harness.see(2.0 + AWAY_S)
    harness.see(3.0 + AWAY_S, "anna")
    assert harness.begin("t").visits == 2
    harness.see(4.0 + AWAY_S, strangers=("7",))
    assert (harness.begin("u").person_id, harness.scene("u").visits) == ("7", 0)


def test_remembered_values_appear_in_current_and_later_visits(
    harness: KnownPersonsHarness,
) -> None:
    harness.see(0.0, "anna", "ben")
    harness.remember("anna", favourite="tea", cups=2)
    assert harness.begin("s").remembered == {"favourite": "tea", "cups": 2.0}
    harness.remember("anna", favourite="water", cups=None)
    assert harness.scene().remembered == {"favourite": "water"}
    ben = harness.estimate.scene_of("ben", now=0.0, wall=0.0, stamp=0.0)
    assert (ben.visits, ben.remembered) == (1, {})
    harness.see(1.0)
    harness.see(2.0 + AWAY_S, "anna")
    assert harness.begin("t").remembered == {"favourite": "water"}


def test_invalid_remember_request_is_rejected_without_change(harness: KnownPersonsHarness) -> None:
    harness.see(0.0, "anna", strangers=("7",))
    assert refusal(harness, "7", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(harness, "nobody", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(harness, "", favourite="tea") == "UNKNOWN_PERSON"
    assert refusal(harness, "anna", favorite="tea") == "BAD_KEY"
    assert refusal(harness, "anna", favourite="tea", cups="two") == "BAD_VALUE"
    assert harness.begin("s").remembered == {}


def test_forgetting_person_drops_remembered_values_until_they_return(
    harness: KnownPersonsHarness,
) -> None:
    harness.see(0.0, "anna")
    harness.remember("anna", favourite="tea")
    assert harness.memory.forget(person="anna")
    assert harness.begin("s").remembered == {}
    assert refusal(harness, "anna", favourite="tea") == "FORGOTTEN"
    persons, _ = harness.memory.snapshot(harness.estimate.encounters.known)
    assert "anna" not in persons


def test_absent_person_is_remembered_across_restart(harness: KnownPersonsHarness) -> None:
    harness.see(0.0, "anna", strangers=("7",))
    harness.remember("anna", favourite="tea", cups=1)
    harness.see(1.0)
    harness.see(2.0 + AWAY_S)
    harness.remember("anna", cups=3)
    text = to_text(*harness.memory.snapshot())
    assert '"7"' not in text
    again = Memory(harness.spec.space)
    again.restore(*from_text(text, harness.spec.space, 5000.0))
    later = KnownPersonsHarness(memory=again)
    later.see(0.0, "anna")
    scene = later.begin("s")
    assert (scene.visits, scene.remembered) == (2, {"favourite": "tea", "cups": 3.0})


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


def test_told_value_lasts_until_newer_measurement(harness: KnownPersonsHarness) -> None:
    harness.see(0.0, "anna")
    harness.begin("s")
    harness.give("s", pain=8.0, noise=3.0)
    values = harness.scene().values
    assert [(one.origin, one.value, one.source) for one in values] == [
        (Origin.TOLD, 8.0, "the person"),
        (Origin.TOLD, 3.0, "the person"),
    ]
    assert harness.scene().observed == (8.0, 3.0)
    harness.now = 1.0
    harness.read("anna", {"mood": 5.0})
    assert harness.pain() == "measured 5"


def test_personal_value_persists_across_interactions_unlike_scene_value(
    harness: KnownPersonsHarness,
) -> None:
    harness.see(0.0, "anna")
    harness.begin("s")
    harness.give("s", pain=8.0, noise=3.0)
    harness.see(1.0, "anna")
    later = harness.begin("t")
    assert [one.origin for one in later.values] == [Origin.TOLD, Origin.MISSING]


def test_personal_value_is_forgotten_when_person_leaves(harness: KnownPersonsHarness) -> None:
    harness.see(0.0, "anna")
    harness.begin("s")
    harness.give("s", told=False, pain=8.0)
    harness.running = "s"
    assert harness.pain() == "given 8"
    harness.see(1.0)
    assert harness.pain() == "missing"
    harness.see(2.0, "anna")
    assert harness.pain() == "missing"


def test_personal_value_does_not_pass_to_next_addressee(harness: KnownPersonsHarness) -> None:
    harness.see(0.0, "anna", "ben")
    harness.begin("s")
    harness.give("s", pain=8.0)
    harness.see(1.0, "ben", "anna")
    assert harness.begin("t").person_id == "ben"
    assert harness.pain("t") == "missing"
    assert harness.pain("s") == "told 8"


def test_value_without_ids_lasts_until_no_person_present() -> None:
    harness = KnownPersonsHarness(WITHOUT_IDS)
    harness.somebody(0.0, True)
    harness.begin("s")
    harness.give("s", pain=8.0, noise=1.0)
    harness.somebody(1.0, True)
    assert [one.origin for one in harness.begin("t").values] == [Origin.TOLD, Origin.MISSING]
    harness.somebody(2.0, False)
    assert harness.pain("t") == "missing"
    harness.somebody(3.0, True)
    assert harness.begin("u").values[0].origin is Origin.MISSING


def test_value_without_measured_person_belongs_to_its_interaction() -> None:
    harness = KnownPersonsHarness(WITHOUT_IDS)
    harness.estimate.begin("s", "", {"pain": 8.0}, True, 0.0)
    assert harness.pain() == "given 8"
    assert harness.begin("t").values[0].origin is Origin.MISSING
    harness.estimate.give("s", {}, False, 1.0)
    assert harness.pain() == "missing"


def test_told_value_of_adopted_scene_stays_told(harness: KnownPersonsHarness) -> None:
    harness.see(0.0, "anna")
    harness.begin("s")
    harness.give("s", noise=3.0)
    other = KnownPersonsHarness()
    other.see(0.0, "anna")
    other.estimate.adopt(harness.scene("s"), 0.0)
    assert other.scene("s").values[1].origin is Origin.TOLD


def test_scripted_person_is_known_until_next_visit() -> None:
    harness = KnownPersonsHarness(WITHOUT_IDS)
    begin = harness.estimate.encounters.begin_visit
    for now, visitor, visits, remembered in (
        (0.0, "anna", 1, {}),
        (1.0, "", 0, {}),
        (2.0, "anna", 2, {"favourite": "tea"}),
        (3.0, "anna", 3, {"favourite": "tea"}),
    ):
        begin(visitor, now, 1000.0 + now)
        scene_id = f"s{now:g}"
        harness.estimate.begin(scene_id, "", {}, True, now, person_id=visitor or None)
        scene = harness.scene(scene_id)
        assert (scene.person_id, scene.visits, scene.remembered) == (visitor, visits, remembered)
        if visits == 1:
            harness.remember("anna", favourite="tea")
