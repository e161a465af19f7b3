# SPDX-License-Identifier: Apache-2.0
"""Persons in front of a real scene layer: real publishers of trackers and sensors."""

from __future__ import annotations

import time
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import ParameterType, ParameterValue
from std_msgs.msg import Empty, Float64, Int32MultiArray, String

from active_nodes import active_scene_layer
from bt_agents.engine.run import Run as TreeRun
from bt_agents.host.environment.open_goal_list import OpenGoalList
from bt_agents.host.environment.ros_environment import RosEnvironment
from bt_agents.host.node import LiveScene
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_interfaces.msg import (
    Face,
    Faces,
    MarketStatus,
    PersonFact,
    PersonIds,
    Persons,
    Run,
    Scene,
    SceneValue,
)
from bt_agents_interfaces.srv import Analyze, ManageProfiles, Remember
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.messages import scene_from_msg
from file_texts import read_agent_text, read_scene_text

PARAMETERS = """
format: 1
parameters:
  age: {min: 0, max: 100, default: 40, description: how old, missing: default}
  mood: {min: 1, max: 5, default: 3, description: how it feels, missing: estimate}
mood: mood
place: lobby
remembers: {favourite: text}
no_person: {mood: 3}
"""
FACES = f"""{PARAMETERS}
persons:
  tracked:
    {{topic: faces, type: bt_agents_interfaces/msg/Faces, field: faces, id: face_id,
      stale_after: 60 s, lost_after: 0.2 s}}
  known: {{from: tracked, field: known}}
  addressee:
    {{rule: nearest, source: {{from: tracked, field: distance_m}}, better_by: 0.2, for: 0.3 s}}
sources:
  age: {{from: tracked, field: age, stale_after: 0.5 s}}
  mood:
    {{from: tracked, field: emotion, table: {{happy: 5, sad: 1}}, confidence: emotion_confidence,
      stale_after: 0.5 s}}
"""
IDS = f"""{PARAMETERS}
persons:
  tracked:
    {{topic: tracked, type: bt_agents_interfaces/msg/PersonIds, field: ids, stale_after: 60 s,
      lost_after: 0 s}}
  parts:
    face: {{topic: persons/<person>/face, type: std_msgs/msg/String, field: data, latched: true}}
  addressee: first
sources:
  age: {{topic: persons/<person>/age, type: std_msgs/msg/Float64, field: data, stale_after: 60 s}}
  mood: {{topic: faces/<face>/mood, type: std_msgs/msg/Float64, field: data, stale_after: 60 s}}
"""


REMEMBERS = """
format: 1
agent: a
profile: {pain: 0, age: 40, mood: 3}
tree:
  sequence:
    - remember: {favourite: "tea for ${person.name}"}
    - set: {scene.pain: 8}
    - check: live.pain == 8 and person.favourite == 'tea for anna'
"""


def face(person: str, **fields: Any) -> Face:
    return Face(
        face_id=person,
        **{"age": 30.0, "emotion": "happy", "emotion_confidence": 1.0, "distance_m": 1.0} | fields,
    )


class Layer:
    """A scene layer and its sensors."""

    def __init__(self, ros: Any, text: str = FACES, memory: Path | None = None) -> None:
        self.ros = ros
        self.faces = ros.node.create_publisher(Faces, "faces", qos.SENSOR)
        self.tracked = ros.node.create_publisher(PersonIds, "tracked", qos.SENSOR)
        self.trigger = ros.node.create_publisher(Empty, "scene_layer/trigger", qos.EVENTS)
        self.runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
        self.market = ros.node.create_publisher(MarketStatus, "bt_agents/market", qos.FACT)
        self.client = ros.node.create_client(Analyze, "scene_layer/analyze")
        self.scenes = ros.collect(Scene, "bt_agents/scene", qos.EVENTS)
        self.live = ros.collect(Scene, "bt_agents/scene/live", qos.SENSOR)
        self.persons = ros.collect(Persons, "bt_agents/scene/persons", qos.FACT)
        self.spec = read_scene_text(text, "scene.yaml")
        numbers = count(1)
        self.memory = memory
        self.ids = lambda: f"s{next(numbers)}"
        self.seen: list[Face] = []
        self.start()

    def start(self) -> None:
        self.node = self.ros.add(active_scene_layer(self.spec, memory=self.memory, ids=self.ids))
        tracker = self.faces if "faces" in self.spec.persons.tracked.topic else self.tracked
        needed = [tracker, self.trigger, self.runs, self.market]
        self.ros.until(lambda: all(p.get_subscription_count() for p in needed))
        self.ros.until(lambda: self.node.count_subscribers("bt_agents/scene/persons"))

    def see_until(self, condition: Any, *faces: Face) -> None:
        """Publish pictures until a condition holds."""

        def holds() -> bool:
            self.faces.publish(Faces(faces=faces))
            self.ros.turns(3)
            return bool(condition())

        self.ros.until(holds)

    def announce(self) -> Scene:
        before = len(self.scenes)
        self.trigger.publish(Empty())
        self.ros.until(lambda: len(self.scenes) > before)
        return self.scenes[-1]

    def remember(self, person: str, *facts: PersonFact) -> Remember.Response:
        return self.ros.ask(Remember, "scene_layer/remember", person_id=person, facts=facts)

    def forget(
        self, layer: str = "person/anna", action: int = ManageProfiles.Request.FORGET
    ) -> ManageProfiles.Response:
        return self.ros.ask(ManageProfiles, "scene_layer/manage", action=action, layer=layer)

    def shown(self) -> str:
        """Return the shown persons, the addressee with a star."""
        if not self.persons:
            return ""
        last = self.persons[-1]
        names = [scene.person_id for scene in last.scenes]
        return " ".join(f"{name}*" if name == last.addressee else name for name in names)


def value(scene: Scene, name: str) -> tuple[int, float]:
    [found] = [v for v in scene.values if v.name == name]
    return found.origin, found.value


def test_robot_addresses_nearest_person(ros):
    layer = Layer(ros)
    layer.see_until(
        lambda: layer.shown() == "anna* ben",
        face("anna", distance_m=1.0, age=70.0),
        face("ben", distance_m=2.0, emotion="sad"),
    )
    assert layer.persons[-1].rule == "nearest"
    assert layer.persons[-1].reason == "anna is nearest: 1 m"
    scene = layer.announce()
    assert scene.person
    assert (scene.person_id, scene.place, scene.persons) == ("anna", "lobby", 2)
    assert value(scene, "age") == (SceneValue.MEASURED, 70.0)
    of_ben = layer.persons[-1].scenes[1]
    assert value(of_ben, "mood") == (SceneValue.MEASURED, 1.0)
    changed = [face("anna", distance_m=2.0), face("ben", distance_m=1.0)]
    layer.see_until(lambda: layer.shown() == "anna ben*", *changed)
    assert layer.persons[-1].reason == "ben has been nearer than anna for 0.3 s"
    layer.see_until(lambda: layer.shown() == "anna*", changed[0])
    layer.see_until(lambda: layer.persons[-1].scenes == [])
    assert layer.persons[-1].addressee == ""


def test_live_scene_keeps_lost_person_of_its_run(ros):
    layer = Layer(ros)
    anna, ben = face("anna", age=70.0), face("ben", distance_m=2.0, age=20.0)
    layer.see_until(lambda: layer.shown() == "anna* ben", anna, ben)
    scene = layer.announce()
    layer.runs.publish(Run(epoch="e", round=1, event=Run.STARTED, scene=scene))
    layer.see_until(lambda: layer.live and layer.live[-1].person, anna, ben)
    layer.see_until(lambda: not layer.live[-1].person, ben)
    layer.see_until(lambda: layer.shown() == "ben*", ben)
    layer.see_until(lambda: value(layer.live[-1], "age")[0] == SceneValue.ESTIMATED, ben)
    assert value(layer.live[-1], "age") == (SceneValue.ESTIMATED, 70.0)
    assert {live.person_id for live in layer.live} == {"anna"}
    layer.see_until(lambda: layer.live[-1].person, anna, ben)
    assert value(layer.live[-1], "age") == (SceneValue.MEASURED, 70.0)
    layer.runs.publish(Run(epoch="e", round=1, event=Run.ENDED, scene=scene))
    layer.market.publish(MarketStatus(epoch="e", round=1, finished_scene_id=scene.scene_id))
    layer.see_until(lambda: layer.shown() == "ben*", ben)
    ros.until(lambda: ros.call(layer.client, Analyze.Request()).scene.person_id == "ben")


def test_named_person_survives_restart_until_forgotten(ros, tmp_path):
    path = tmp_path / "memory.json"
    layer = Layer(ros, memory=path)
    anna, stranger = face("anna", known=True, age=70.0), face("face7", distance_m=3.0, age=20.0)
    layer.see_until(lambda: layer.shown() == "anna* face7", anna, stranger)
    layer.node.request_stop()
    ros.until(layer.node.stopped)
    ros.remove(layer.node)
    assert '"anna"' in path.read_text()
    assert "face7" not in path.read_text()

    layer.start()
    silent = face("anna", known=True, age=float("nan"), emotion="")
    layer.see_until(lambda: layer.persons[-1].scenes and layer.shown() == "anna*", silent)
    layer.see_until(lambda: value(layer.announce(), "age") == (SceneValue.ESTIMATED, 70.0), silent)
    [age, _] = layer.scenes[-1].values
    assert age.source == "anna, seen 2 times"
    assert 0.0 < age.std < 30.0

    answer = layer.forget()
    assert (answer.accepted, answer.message) == (True, "person/anna is forgotten")
    assert "anna" not in path.read_text()
    assert layer.forget().message == "nothing was known of person/anna"
    assert value(layer.announce(), "age") == (SceneValue.DEFAULT, 40.0)
    for fields, code in (
        ({"action": ManageProfiles.Request.UNDO}, "UNKNOWN_ACTION"),
        ({"layer": "anna"}, "UNKNOWN_LAYER"),
        ({"layer": "person/"}, "UNKNOWN_LAYER"),
    ):
        answer = layer.forget(**fields)
        assert (answer.accepted, answer.code) == (False, code)


def test_tree_remembers_person_and_updates_live_scene(ros, monkeypatch):
    # The live scene shows the value before the tree goes on, even on a slow machine.
    monkeypatch.setattr("bt_agents.engine.nodes.set._SHOWN_WITHIN_S", 300.0)
    pain = "parameters:\n  pain: {min: 0, max: 10, default: 0, of: person}\n"
    layer = Layer(ros, FACES.replace("parameters:\n", pain))
    anna = face("anna", known=True)
    layer.see_until(lambda: layer.shown() == "anna*", anna)
    message = layer.announce()
    assert (message.visits, message.remembered) == (1, [])
    layer.runs.publish(Run(epoch="e", round=1, event=Run.STARTED, scene=message))
    space = layer.spec.space
    awarded = scene_from_msg(message, space)
    spec = read_agent_text(REMEMBERS, "a.yaml", SymbolTable(space, {}))
    run = TreeRun(
        spec,
        space=space,
        scene=awarded,
        profile=spec.profile,
        live=LiveScene(ros.node, space).begin_run(awarded),
        tunables={},
        environment=RosEnvironment(
            ros.node,
            lambda: None,
            run_goal=lambda: None,
            open_goals=OpenGoalList(ros.node, "first", lambda: None),
            space=space,
        ),
        steady=time.monotonic,
    )
    layer.see_until(lambda: (run.tick(), run.result)[1], anna)
    assert run.result is not None
    assert (run.result.outcome.name, run.result.message) == ("SUCCEEDED", "the tree succeeded")
    later = layer.announce()
    assert value(later, "pain") == (SceneValue.TOLD, 8.0)
    assert [(one.key, one.value.string_value) for one in later.remembered] == [
        ("favourite", "tea for anna")
    ]
    live = scene_from_msg(layer.live[-1], space)
    assert (live.get("pain"), live.remembered) == (8.0, {"favourite": "tea for anna"})
    refused = layer.remember("face7")
    assert (refused.accepted, refused.code) == (False, "UNKNOWN_PERSON")


def test_manually_named_person_is_known_to_robot(ros):
    layer = Layer(ros)
    tea = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="tea")

    def named(name: str, person: int = Analyze.Request.PRESENT) -> Analyze.Response:
        return ros.call(layer.client, Analyze.Request(announce=True, person=person, name=name))

    first = named("anna").scene
    assert (first.person, first.person_id, first.visits) == (True, "anna", 1)
    kept = layer.remember("anna", PersonFact(key="favourite", value=tea))
    assert kept.message == "remembered of anna; the memory ends with the scene layer"
    assert named("ben").scene.visits == 1
    second = named("anna").scene
    assert (second.visits, [one.value for one in second.remembered]) == (2, [tea])
    for refused, code in (
        (named("anna", Analyze.Request.ABSENT), "NAMED_NOBODY"),
        (named("a\nb"), "BAD_TEXT"),
        (ros.call(layer.client, Analyze.Request(name="anna")), "NAMED_NOBODY"),
    ):
        assert (refused.accepted, refused.code) == (False, code)


def test_damaged_memory_is_set_aside_at_start(ros, tmp_path):
    path = tmp_path / "memory.json"
    path.write_text('{"format": 1, "persons": ')
    layer = Layer(ros, memory=path)
    assert (tmp_path / "memory.json.damaged").read_text() == '{"format": 1, "persons": '
    layer.see_until(lambda: layer.shown() == "anna*", face("anna", known=True))
    layer.node.request_stop()
    ros.until(layer.node.stopped)
    assert '"anna"' in path.read_text()


def test_forgetting_fails_when_memory_file_is_unwritable(ros, tmp_path):
    folder, away = tmp_path / "state", tmp_path / "away"
    layer = Layer(ros, memory=folder / "memory.json")
    layer.see_until(lambda: layer.shown() == "anna*", face("anna", known=True))
    folder.write_text("no folder")
    answer = layer.forget()
    assert (answer.accepted, answer.code) == (False, "STORAGE_FULL")
    assert "its file still has it" in answer.message
    folder.rename(away)
    assert layer.forget().accepted
    assert (folder / "memory.json").exists()


def test_foreign_memory_file_stays_unchanged_and_prevents_start(ros, tmp_path):
    path = tmp_path / "ledger.sqlite"
    path.write_text("SQLite format 3")
    with pytest.raises(BtAgentsError, match="is not a memory"):
        Layer(ros, memory=path)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [
        ("ledger.sqlite", "SQLite format 3")
    ]


NUMBERED = """
format: 1
parameters:
  age: {{min: 0, max: 100, default: 40}}
persons:
  tracked: {{topic: tracked, type: {type}, field: {field}, stale_after: 60 s, lost_after: 0 s}}
"""


@pytest.mark.parametrize(
    ("type_name", "field", "messages", "shown"),
    [
        (
            "bt_agents_interfaces/msg/Persons",
            "scenes.0.values, id: name",
            [
                Persons(scenes=[Scene(values=[SceneValue(name="anna"), SceneValue(name="ben")])]),
                Persons(),
            ],
            [["anna", "ben"], []],
        ),
        (
            "std_msgs/msg/Int32MultiArray",
            "data",
            [Int32MultiArray(data=[7, 12, 7]), Int32MultiArray(data=[12])],
            [["7", "12"], ["12"]],
        ),
    ],
    ids=["nested list", "numbers"],
)
def test_tracker_may_send_nested_lists_or_numbers(ros, type_name, field, messages, shown):
    text = NUMBERED.format(type=type_name, field=field)
    ros.add(active_scene_layer(read_scene_text(text, "scene.yaml", InstalledInterfaces())))
    publisher = ros.node.create_publisher(type(messages[0]), "tracked", qos.SENSOR)
    persons = ros.collect(Persons, "bt_agents/scene/persons", qos.FACT)
    # The layer first publishes that nobody is there.
    ros.until(lambda: publisher.get_subscription_count() and persons)
    for number, message in enumerate(messages, start=2):
        publisher.publish(message)
        ros.until(lambda number=number: len(persons) == number)
    assert [[scene.person_id for scene in one.scenes] for one in persons[1:]] == shown


def test_unusable_topic_is_refused_by_name(ros):
    of_two_types = """
    [{topic: mood, type: std_msgs/msg/Float64, field: data, stale_after: 1 s},
     {topic: /mood, type: std_msgs/msg/Float32, field: data, stale_after: 1 s}]
    """
    spec = read_scene_text(f"{PARAMETERS}\nsources:\n  mood:{of_two_types}", "scene.yaml")
    with pytest.raises(Refused, match="topic /mood cannot be heard") as refused:
        active_scene_layer(spec)
    assert refused.value.code == "UNUSABLE_TOPIC"


def test_person_topics_are_subscribed_only_while_tracked(ros):
    layer = Layer(ros, IDS)
    ages = ros.node.create_publisher(Float64, "persons/anna/age", qos.SENSOR)
    faces = ros.node.create_publisher(String, "persons/anna/face", qos.FACT)
    moods = ros.node.create_publisher(Float64, "faces/f1/mood", qos.SENSOR)
    faces.publish(String(data="f1"))
    ros.turns()
    assert not ages.get_subscription_count()
    layer.tracked.publish(PersonIds(ids=["anna", "ben"]))
    ros.until(lambda: ages.get_subscription_count() and moods.get_subscription_count())
    ages.publish(Float64(data=70.0))
    moods.publish(Float64(data=4.0))
    ros.until(
        lambda: (
            layer.persons
            and [v.value for s in layer.persons[-1].scenes[:1] for v in s.values] == [70.0, 4.0]
        )
    )
    layer.tracked.publish(PersonIds(ids=["ben"]))
    ros.until(lambda: not ages.get_subscription_count() and not moods.get_subscription_count())
    ros.until(lambda: layer.shown() == "ben*")


def test_hostile_tracker_neither_stops_nor_floods_scene_layer(ros):
    layer = Layer(ros, IDS)
    hostile = ["a/b", "x y", "", "9lives", "a" * 10_000, "../..", "{person}", "anna", "anna", "ü"]
    crowd = [f"p{number}" for number in range(10_000)]
    layer.tracked.publish(PersonIds(ids=[*hostile, *crowd]))
    ros.until(lambda: layer.persons and layer.persons[-1].scenes)
    assert layer.persons[-1].addressee == "a/b"
    assert len(layer.persons[-1].scenes) == 50
    ages = [name for name, _ in layer.node.get_topic_names_and_types() if name.endswith("/age")]
    assert len(ages) <= 50
    ros.until(lambda: layer.node.count_subscribers("persons/anna/age"))
    layer.tracked.publish(PersonIds(ids=["anna"]))
    ros.until(lambda: layer.shown() == "anna*")
    ros.until(lambda: not layer.node.count_subscribers("persons/p1/age"))
    assert layer.announce().person_id == "anna"
