# SPDX-License-Identifier: Apache-2.0
"""A scene layer without ROS, on a manual clock, and its scenes as short texts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from bt_agents_core.diagnostic import Position
from bt_agents_core.scene import Origin, Scene, SceneValue
from bt_agents_language.model.scene_specs import (
    AddresseeRule,
    AddresseeSpec,
    PersonsSpec,
    SceneSpec,
    SourceSpec,
    TrackedSpec,
)
from plain_message import message_of
from scene_layer.memory import Memory
from scene_layer.persons import Persons
from scene_layer.scene_estimator import SceneEstimator
from scene_layer.sources import Sources
from scene_spaces import source as new_source

_HERE = Position(file="scene.yaml", line=1, column=1)
_USUAL = {"known": 0.0, "sure": 1.0, "age_std": 0.0}


def number_source(
    parameter: str, *points: tuple[float, float], topic: str = "", line: int = 1
) -> SourceSpec:
    """Return the source of a number, stale after 2 s."""
    found = new_source(parameter, "std_msgs/msg/Float64", *points, stale_after_s=2.0)
    position = Position(file="scene.yaml", line=line, column=1)
    return replace(found, topic=topic or found.topic, position=position)


def persons_of(rule: AddresseeRule) -> Persons:
    """Return persons of which the best by 0.2 for 1 s is the addressee; 0.5 s may be a gap."""
    tracked = TrackedSpec(
        topic="tracked",
        type="bt_agents_interfaces/msg/PersonIds",
        field="ids",
        stale_after_s=3.0,
        lost_after_s=0.5,
        position=_HERE,
    )
    addressee = AddresseeSpec(rule=rule, better_by=0.2, hold_s=1.0)
    return Persons(PersonsSpec(tracked=tracked, addressee=addressee))


def words(scene: Scene) -> list[str]:
    """Return each value of a scene like ``"age measured 4"``; a missing one is only its name."""
    return [
        v.name if v.origin is Origin.MISSING else f"{v.name} {v.origin.name.lower()} {v.value:g}"
        for v in scene.values
    ]


class SceneLayerHarness:
    """Drives the estimates of one scene; ``running`` is the scene that has a run."""

    def __init__(self, spec: SceneSpec, memory: Memory | None = None) -> None:
        self.spec = spec
        self.sources = Sources(spec)
        self.memory = memory or Memory(spec.space)
        self.estimate = SceneEstimator(spec, self.sources, self.memory)
        self.running: str | None = None
        self.now = 0.0

    def see(self, now: float, **people: Mapping[str, float]) -> None:
        """Take a picture of tracked persons, each with what is measured of them."""
        self.now = now
        persons = self.estimate.encounters.persons
        persons.receive_ids(list(people), now)
        for person in persons.candidates:
            if person in people:
                self.read(person, {**_USUAL, **people[person]})
        self.look()

    def watch(self, seconds: range, **people: Mapping[str, float]) -> None:
        """Take the same picture at some seconds."""
        for second in seconds:
            self.see(float(second), **people)

    def read(self, person: str, item: Mapping[str, float]) -> None:
        """Take readings of a person; sources of fields that it lacks read nothing."""
        for source in self.spec.every_source:
            names = {name.removeprefix("msg.") for name in source.field.names}
            if source.of_item and names <= item.keys():
                self.sources.read(source, message_of(item), self.now, person)

    def hear(self, value: object, parameter: str = "noise", now: float | None = None) -> None:
        """Take a reading that belongs to no particular person."""
        self.now = self.now if now is None else now
        sources = (s for s in self.spec.every_source if s.parameter == parameter)
        source = next(one for one in sources if not one.per_person)
        self.sources.read(source, message_of({"data": value}), self.now)

    def look(self, now: float | None = None) -> bool:
        self.now = self.now if now is None else now
        return self.estimate.update(self.now, 1000.0 + self.now, self.running)

    def announce(self, scene_id: str = "s", person: bool | None = None, **given: float) -> Scene:
        self.estimate.begin(scene_id, "", given, person, self.now)
        return self.scene(scene_id)

    def give(self, told: bool = True, **values: float) -> None:
        self.estimate.give("s", values, None, self.now, told=told)

    def scene(self, scene_id: str = "s", now: float | None = None) -> Scene:
        self.now = self.now if now is None else now
        return self.estimate.scene(scene_id, now=self.now, wall=1000.0 + self.now, stamp=0.0)

    def value(self, name: str, scene_id: str = "s") -> SceneValue:
        [value] = [one for one in self.scene(scene_id).values if one.name == name]
        return value
