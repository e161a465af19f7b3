# SPDX-License-Identifier: Apache-2.0
"""The shipped scene files, fed by real publishers of the types that they name."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Bool, Float64, String

from active_nodes import active_scene_layer
from bt_agents_core.errors import ReadError
from bt_agents_interfaces.msg import (
    EngagementLevel,
    Expression,
    Face,
    Faces,
    PersonIds,
    Scene,
    SceneValue,
    SoftBiometrics,
)
from bt_agents_interfaces.srv import Analyze
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from file_texts import read_scene_text
from tree_harness import TREES


def ros4hri() -> SceneSpec:
    """The file for ROS4HRI, read with types of this project that have the same fields."""
    path = TREES / "scenes" / "ros4hri.yaml"
    text = path.read_text(encoding="utf-8")
    text = text.replace("hri_msgs/msg/IdsList", "bt_agents_interfaces/msg/PersonIds")
    text = text.replace("hri_msgs/msg/", "bt_agents_interfaces/msg/")
    return read_scene_text(text, str(path), InstalledInterfaces())


class Robot:
    """A scene layer and its sensors, which publish until it has the values."""

    def __init__(self, ros, spec: SceneSpec) -> None:
        self.ros = ros
        self._sensors: list[tuple[Any, Any]] = []
        self.layer = ros.add(active_scene_layer(spec))
        self._analyze = ros.node.create_client(
            Analyze, "scene_layer/analyze", qos_profile=qos.SERVICE
        )

    def senses(self, topic: str, message: Any, *, latched: bool = False) -> None:
        """Publish a message now, or repeatedly while the test waits for something."""
        profile = qos.FACT if latched else qos.SENSOR
        publisher = self.ros.node.create_publisher(type(message), topic, profile)
        if latched:
            publisher.publish(message)
        else:
            self._sensors.append((publisher, message))

    def scene(self) -> Scene:
        for publisher, message in self._sensors:
            publisher.publish(message)
        return self.ros.call(self._analyze, Analyze.Request()).scene

    def until(self, holds: Callable[[Scene], bool]) -> Scene:
        self.ros.until(lambda: holds(self.scene()))
        return self.scene()


def measured(scene: Scene) -> dict[str, SceneValue]:
    return {v.name: v for v in scene.values if v.origin == SceneValue.MEASURED}


def test_ros4hri_scene_combines_person_and_face(ros):
    robot = Robot(ros, ros4hri())
    assert not robot.scene().person
    person, face = "/humans/persons/anna", "/humans/faces/f17"
    robot.senses(f"{person}/face_id", String(data="f17"), latched=True)
    robot.senses(f"{person}/anonymous", Bool(data=False), latched=True)
    engaged = EngagementLevel(level=EngagementLevel.ENGAGED)
    robot.senses(f"{person}/engagement_status", engaged)
    robot.senses("/humans/persons/tracked", PersonIds(ids=["anna"]))
    robot.senses(f"{face}/softbiometrics", SoftBiometrics(age=65.0, age_confidence=0.25))
    robot.senses(f"{face}/expression", Expression(valence=0.5, arousal=0.0, confidence=1.0))
    scene = robot.until(lambda scene: len(measured(scene)) == 3)
    assert (scene.person, scene.person_id, scene.persons) == (True, "anna", 1)
    values = measured(scene)
    assert values["age"].value == pytest.approx(4.0)
    assert values["age"].confidence == pytest.approx(0.25)
    assert values["age"].std == pytest.approx(8 / 20 / math.sqrt(0.25))
    assert values["familiarity"].value == 5.0
    assert values["mood"].value == pytest.approx(4.0)
    assert values["mood"].std == pytest.approx(0.5)


@pytest.mark.parametrize("unknown", [0.0, math.nan])
def test_expression_word_sets_mood_without_valence(ros, unknown):
    robot = Robot(ros, ros4hri())
    for person, word in (("anna", "happy"), ("ben", "sad"), ("eve", "")):
        robot.senses(f"/humans/persons/{person}/face_id", String(data=f"f_{person}"), latched=True)
        face = Expression(expression=word, confidence=0.9, valence=unknown, arousal=unknown)
        robot.senses(f"/humans/faces/f_{person}/expression", face)
    tracked = robot.ros.node.create_publisher(PersonIds, "/humans/persons/tracked", qos.SENSOR)
    for person, mood in (("anna", 4.5), ("ben", 1.5)):

        def is_there(scene: Scene, person: str = person) -> bool:
            tracked.publish(PersonIds(ids=[person]))
            return scene.person_id == person and "mood" in measured(scene)

        value = measured(robot.until(is_there))["mood"]
        assert (value.value, value.confidence) == (mood, pytest.approx(0.9))

    def is_eve(scene: Scene) -> bool:
        tracked.publish(PersonIds(ids=["eve"]))
        return scene.person_id == "eve"

    assert "mood" not in measured(robot.until(is_eve))


@pytest.mark.parametrize("arousal", [0.0, math.nan])
def test_valence_takes_precedence_over_expression_word(ros, arousal):
    robot = Robot(ros, ros4hri())
    robot.senses("/humans/persons/anna/face_id", String(data="f"), latched=True)
    robot.senses("/humans/persons/tracked", PersonIds(ids=["anna"]))
    face = Expression(expression="angry", valence=0.5, arousal=arousal, confidence=1.0)
    robot.senses("/humans/faces/f/expression", face)
    scene = robot.until(lambda scene: "mood" in measured(scene))
    assert measured(scene)["mood"].value == pytest.approx(4.0)


def test_engaged_person_becomes_addressee(ros):
    # hri_engagement publishes at every run of its timer and keeps nothing for late subscribers.
    robot = Robot(ros, ros4hri())
    for person, level in (
        ("first", EngagementLevel.DISENGAGED),
        ("second", EngagementLevel.ENGAGED),
    ):
        topic = f"/humans/persons/{person}/engagement_status"
        robot.senses(topic, EngagementLevel(level=level))
    robot.senses("/humans/persons/tracked", PersonIds(ids=["first", "second"]))
    assert robot.until(lambda scene: scene.person_id == "second").persons == 2


@pytest.mark.parametrize("latched", [True, False])
def test_anonymous_person_has_lowest_familiarity(ros, latched):
    # The source is latched, and hears a volatile publisher, too.
    robot = Robot(ros, ros4hri())
    robot.senses("/humans/persons/p1/anonymous", Bool(data=True), latched=latched)
    robot.senses("/humans/persons/tracked", PersonIds(ids=["p1"]))
    scene = robot.until(lambda scene: "familiarity" in measured(scene))
    assert measured(scene)["familiarity"].value == 1.0
    assert set(measured(scene)) == {"familiarity"}


def test_face_scene_uses_nearest_face_and_room_audio(ros):
    robot = Robot(ros, read_scene(TREES / "scenes" / "faces.yaml", InstalledInterfaces()))
    near = Face(face_id="anna", known=True, age=25.0, age_std=5.0, distance_m=0.8)
    near.emotion, near.emotion_confidence = "happy", 0.7
    far = Face(face_id="7", known=False, age=65.0, age_std=5.0, distance_m=3.0)
    far.emotion, far.emotion_confidence = "sad", 1.0
    robot.senses("camera/faces", Faces(faces=[far, near]))
    scene = robot.until(lambda scene: scene.person_id == "anna" and len(measured(scene)) == 3)
    assert (scene.place, scene.persons) == ("lobby", 2)
    values = measured(scene)
    assert values["age"].value == pytest.approx(2.0)
    assert values["age"].std == pytest.approx(5 / 20)
    assert values["familiarity"].value == 5.0
    assert values["mood"].value == 5.0
    assert values["mood"].confidence == pytest.approx(0.7)
    robot.senses("audio/valence", Float64(data=-1.0))
    scene = robot.until(lambda scene: measured(scene)["mood"].value < 5.0)
    mood = measured(scene)["mood"]
    assert mood.value == pytest.approx((0.7 * 5.0 + 0.3 * 1.0) / 1.0)
    assert mood.source == "audio/valence and camera/faces"


def test_camera_without_face_reports_no_person(ros):
    robot = Robot(ros, read_scene(TREES / "scenes" / "faces.yaml"))
    robot.senses("camera/faces", Faces())
    ros.turns(20)
    scene = robot.scene()
    assert (scene.person, scene.person_id, scene.persons) == (False, "", 0)
    found = {value.name: (value.value, value.origin) for value in scene.values}
    assert found["mood"] == (3.0, SceneValue.DEFAULT)


def test_hostile_faces_have_no_effect(ros):
    robot = Robot(ros, read_scene(TREES / "scenes" / "faces.yaml"))
    bad = Face(face_id="eve", known=True, age=math.nan, age_std=-1.0, distance_m=math.inf)
    bad.emotion, bad.emotion_confidence = "x" * 10_000, 7.0
    robot.senses("camera/faces", Faces(faces=[bad]))
    scene = robot.until(lambda scene: "familiarity" in measured(scene))
    assert set(measured(scene)) == {"familiarity"}
    assert scene.person_id == "eve"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("field: age", "field: msg.agee * 2", "did you mean age?"),
        ("std: age_std", "std: age_sdt", "did you mean age_std?"),
        ("id: face_id", "id: faceid", "did you mean face_id?"),
        ("field: faces", "field: face", "did you mean faces?"),
        ("field: emotion", "field: msg.emotion + 1", "needs a number on each side"),
        ("field: known}", "field: face_id}", "'field' is a text"),
        ("id: face_id", "id: distance_m", "'id' (distance_m) is a number with a fraction"),
        ("    id: face_id\n", "", "an item of 'field' is a message, expected a text"),
        ("type: std_msgs/msg/Float64", "type: std_msgs/msg/Float64MultiArray", "is a list"),
        ("type: std_msgs/msg/Float64", "type: std_msgs/msg/Header", "no field 'data'"),
        ("table: {true: 5, false: 1}", "table: {yes: 5, no: 1}", "expected true or false"),
        ("topic: audio/valence", "topic: camera/faces", "has the type std_msgs/msg/Float64 here"),
    ],
)
def test_fields_missing_from_installed_types_are_reported(old, new, words):
    text = (TREES / "scenes" / "faces.yaml").read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(ReadError) as found:
        read_scene_text(text.replace(old, new), "scene.yaml", InstalledInterfaces())
    assert words in found.value.diagnostics[0].message


def test_publisher_of_other_type_is_named(ros, stranger):
    robot = Robot(ros, read_scene(TREES / "scene.yaml"))
    heard = []
    ros.node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda one: heard.extend(one.status), qos.EVENTS
    )
    stranger.node.create_publisher(String, "person/age", 1)
    message = "person/age is published as std_msgs/msg/String, expected std_msgs/msg/Float64"
    ros.until(lambda: heard and heard[-1].message == message)
    assert (heard[-1].name, heard[-1].level) == ("scene_layer: sources", DiagnosticStatus.ERROR)
    assert robot.scene().values
