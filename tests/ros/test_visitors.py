# SPDX-License-Identifier: Apache-2.0
"""Simulated visitors with a real scene layer, and a market played by the test."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Bool, String

from active_nodes import active_scene_layer
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Faces, MarketStatus, Run, Scene, SceneValue
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_language.model.specs import SceneChange, Script, Visit
from bt_agents_robot.visitors import VisitorsNode
from bt_agents_ros import qos
from file_texts import read_scene_text
from scene_spaces import AGE_AND_MOOD as SPACE
from scene_spaces import source

SPEC = SceneSpec(
    space=SPACE,
    sources=(
        source("age", "std_msgs/msg/Int32", (0.0, 1.0), (80.0, 5.0), stale_after_s=0.5),
        source("mood", "std_msgs/msg/Float64", (-1.0, 1.0), (1.0, 5.0), stale_after_s=0.5),
    ),
    person=source("person", "std_msgs/msg/Bool", stale_after_s=0.5),
)


def measured(scene: Scene) -> dict[str, float]:
    assert all(value.origin != SceneValue.GIVEN for value in scene.values)
    return {v.name: v.value for v in scene.values if v.origin == SceneValue.MEASURED}


class Street:
    """Visitors, a scene layer, and a market played by the test."""

    def __init__(self, ros, *visits: Visit, spec: SceneSpec = SPEC) -> None:
        self.ros = ros
        self.scenes = ros.collect(Scene, "bt_agents/scene", qos.EVENTS)
        self.live = ros.collect(Scene, "bt_agents/scene/live", qos.SENSOR)
        self.current = ros.collect(String, "visitors/current", qos.FACTS)
        self.done = ros.collect(Bool, "visitors/done", qos.FACT)
        self.said = ros.collect(String, "answers", qos.EVENTS)
        self.market = ros.node.create_publisher(MarketStatus, "bt_agents/market", qos.FACT)
        self.runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
        self.questions = ros.node.create_publisher(String, "robot/questions", qos.EVENTS)
        self.acts = ros.node.create_publisher(String, "robot/transcript", qos.EVENTS)
        self.layer = ros.add(active_scene_layer(spec))
        script = Script(title="", visits=visits)
        overrides = [Parameter("pace", value=20.0)]
        self.node = ros.add(VisitorsNode(spec, script, parameter_overrides=overrides))
        publishers = (self.market, self.runs, self.questions, self.acts)
        ros.until(lambda: all(p.get_subscription_count() for p in publishers))
        ros.until(lambda: self.runs.get_subscription_count() == 2)
        ros.turns(20)

    def idle(self, finished: str = "") -> None:
        self.market.publish(MarketStatus(epoch="e", agents=1, finished_scene_id=finished))

    def meet(self) -> None:
        """Wait for the scene of the first visitor."""
        self.idle()
        self.ros.until(lambda: self.scenes)

    def begin(self) -> None:
        """Start the run for the first visitor."""
        self.meet()
        self.start(1)

    def start(self, number: int) -> None:
        status = MarketStatus(epoch="e", agents=1, round=number, state=MarketStatus.RUNNING)
        self.market.publish(status)
        run = Run(epoch="e", round=number, event=Run.STARTED, scene=self.scenes[number - 1])
        run.host = self.ros.node.get_fully_qualified_name()
        self.runs.publish(run)

    def finish(self, number: int) -> None:
        scene = self.scenes[number - 1]
        self.runs.publish(Run(epoch="e", round=number, event=Run.ENDED, scene=scene))
        self.idle(scene.scene_id)


def visit(label: str, *, person: bool = True, **values: float) -> Visit:
    return Visit(label=label, person=person, values=values)


def test_visitors_are_sensed_in_sequence(ros):
    ladder = replace(visit("ladder", person=False, mood=2.0), urgent=True)
    street = Street(ros, visit("a", age=3.0, mood=4.0), ladder)
    ros.turns(20)
    assert street.scenes == []
    street.meet()
    assert measured(street.scenes[0]) == {"age": 3.0, "mood": 4.0}
    assert street.scenes[0].person
    street.start(1)
    street.finish(1)
    ros.until(lambda: len(street.scenes) == 2)
    assert measured(street.scenes[1]) == {"mood": 2.0}, "the age of the first visitor is stale"
    assert not street.scenes[1].person
    street.start(2)
    street.finish(2)
    ros.until(lambda: street.done)
    assert [label.data for label in street.current] == ["a", "", "ladder", ""]
    assert [scene.urgent for scene in street.scenes] == [False, True]


def test_change_without_effect_is_reported(ros, monkeypatch):
    # The first change has its effect, however late.
    monkeypatch.setattr("bt_agents_robot.change_effects.EFFECT_S", 300.0)
    changes = (
        SceneChange(after_s=0.2, values={"mood": 1.0}, person=False),
        SceneChange(after_s=6000.0, values={"mood": 2.0}),
    )
    street = Street(ros, Visit(label="a", person=True, values={"mood": 4.0}, changes=changes))
    remarks = ros.collect(String, "visitors/remarks", qos.FACTS)
    street.begin()
    ros.until(lambda: street.live and measured(street.live[-1]) == {"mood": 1.0})
    ros.until(lambda: not street.live[-1].person)
    street.finish(1)
    ros.until(lambda: street.done and remarks)
    said = "a: mood 2 after 6000 s had no effect: the visit was over by then"
    assert [one.data for one in remarks] == [said]


def test_change_that_no_live_scene_shows_is_reported(ros):
    change = SceneChange(after_s=0.2, values={"mood": 1.0})
    street = Street(ros, Visit(label="a", person=True, values={"mood": 4.0}, changes=(change,)))
    remarks = ros.collect(String, "visitors/remarks", qos.FACTS)
    street.meet()
    ros.executor.remove_node(street.layer)
    street.start(1)
    ros.until(lambda: remarks)
    assert "has not shown it within 2 s" in remarks[0].data


def test_visitor_answers_question_by_keyword(ros):
    polite = Visit(label="a", person=True, values={"mood": 4.0}, answers={"go": "yes"})
    street = Street(ros, polite)
    street.questions.publish(String(data="Shall we go?"))
    ros.turns()
    street.begin()
    street.questions.publish(String(data="What time is it?"))
    street.questions.publish(String(data="Shall we go?"))
    ros.until(lambda: street.said)
    ros.turns()
    assert [said.data for said in street.said] == ["yes"], "nobody was there for the first one"


PRESSER = Visit(
    label="a", person=True, values={"mood": 4.0}, buttons={"buttons/ok": "green button"}
)


def test_named_button_is_pressed_once_tree_listens(ros, capfd):
    street = Street(ros, PRESSER, PRESSER)
    heard_elsewhere: list[Bool] = []
    recorder = ros.add(Node("recorder"))
    recorder.create_subscription(Bool, "buttons/ok", heard_elsewhere.append, qos.EVENTS)
    street.begin()
    street.acts.publish(String(data="shows: Good morning."))
    ros.turns(20)
    assert not street.node._presses._planned
    street.acts.publish(String(data="says: Press the green button to start."))
    ros.until(lambda: street.node._presses._planned)
    ros.turns(20)
    assert heard_elsewhere == []
    pressed = ros.collect(Bool, "buttons/ok", qos.EVENTS)
    ros.until(lambda: pressed)
    street.finish(1)
    ros.until(lambda: len(street.scenes) == 2)
    assert len(pressed) == 1
    assert "was not pressed" not in capfd.readouterr().err


def test_unpressed_button_is_reported_when_visitor_leaves(ros, capfd):
    street = Street(ros, PRESSER)
    street.begin()
    street.acts.publish(String(data="says: Press the green button to start."))
    ros.until(lambda: street.node._presses._planned)
    planned = street.node._presses._planned["buttons/ok"]
    ros.until(lambda: time.monotonic() > planned)
    street.finish(1)
    ros.until(lambda: street.done)
    assert "a: 'buttons/ok' was not pressed, as no tree listened" in capfd.readouterr().err


def test_visitors_wait_for_scene_layer(ros):
    street = Street(ros, visit("a", mood=4.0))
    ros.remove(street.layer)
    ros.until(lambda: street.node.count_subscribers("scene_layer/trigger") == 0)
    street.idle()
    ros.turns(20)
    assert street.scenes == []
    ros.add(active_scene_layer(SPEC))
    ros.until(lambda: len(street.scenes) == 1)
    assert measured(street.scenes[0]) == {"mood": 4.0}


TRACKED = """
format: 1
parameters:
  age: {min: 1, max: 5, default: 3}
  mood: {min: 1, max: 5, default: 3}
mood: mood
persons:
"""
FACES = f"""{TRACKED}
  tracked:
    {{topic: faces, type: bt_agents_interfaces/msg/Faces, field: faces, id: face_id,
      stale_after: 1 s, lost_after: 0.2 s}}
  known: {{from: tracked, field: known}}
  addressee: {{rule: nearest, source: {{from: tracked, field: distance_m}}, for: 0.1 s}}
sources:
  age: {{from: tracked, field: age, map: {{5: 1, 85: 5}}}}
  mood:
    {{from: tracked, field: emotion, table: {{happy: 5, sad: 1}}, confidence: emotion_confidence}}
"""
IDS = f"""{TRACKED}
  tracked:
    {{topic: tracked, type: bt_agents_interfaces/msg/PersonIds, field: ids, stale_after: 1 s,
      lost_after: 0.2 s}}
  parts:
    face: {{topic: persons/<person>/face, type: std_msgs/msg/String, field: data, latched: true}}
  addressee: first
sources:
  age: {{topic: persons/<person>/age, type: std_msgs/msg/Float64, field: data, stale_after: 1 s}}
  mood: {{topic: faces/<face>/mood, type: std_msgs/msg/Float64, field: data, stale_after: 1 s}}
"""


@pytest.mark.parametrize("text", [FACES, IDS], ids=["items", "topics"])
def test_visitors_are_tracked(ros, text):
    leaves = SceneChange(after_s=0.0, values={}, person=False)
    lady = Visit(label="lady", person=True, values={"age": 4.0, "mood": 5.0}, changes=(leaves,))
    street = Street(
        ros, lady, visit("child", age=1.0, mood=1.0), spec=read_scene_text(text, "scene.yaml")
    )
    street.meet()
    assert measured(street.scenes[0]) == pytest.approx({"age": 4.0, "mood": 5.0})
    assert (street.scenes[0].person, street.scenes[0].person_id) == (True, "visitor1")
    street.start(1)
    ros.until(lambda: street.live and not street.live[-1].person)
    street.finish(1)
    ros.until(lambda: len(street.scenes) == 2)
    assert measured(street.scenes[1]) == pytest.approx({"age": 1.0, "mood": 1.0})
    assert street.scenes[1].person_id == "visitor2"


def test_a_visitor_may_be_known_by_name(ros):
    anna = Visit(label="anna comes", person=True, values={"mood": 5.0}, name="anna")
    faces = ros.collect(Faces, "faces", qos.SENSOR)
    street = Street(ros, anna, spec=read_scene_text(FACES, "scene.yaml"))
    street.meet()
    assert street.scenes[0].person_id == "anna"
    [seen] = faces[-1].faces
    assert (seen.face_id, seen.known, seen.emotion) == ("anna", True, "happy")


def test_visitor_name_is_refused_for_numeric_ids(ros):
    reading = "field: data, stale_after: 1 s"
    text = f"""{TRACKED}
  tracked: {{topic: t, type: std_msgs/msg/Int32MultiArray, {reading}}}
  known: {{topic: persons/<person>/known, type: std_msgs/msg/Bool, {reading}}}
"""
    spec = read_scene_text(text, "scene.yaml")
    anna = Visit(label="anna comes", person=True, values={}, name="anna")
    with pytest.raises(Refused, match="persons have numbers there") as found:
        VisitorsNode(spec, Script(title="", visits=(anna,)))
    assert found.value.code == "NAMED_VISITOR"


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (source("mood", field="msg.data + 1"), r"cannot write msg\.data \+ 1"),
        (source("mood", "std_msgs/msg/String"), r"expected a boolean or a number"),
    ],
)
def test_unsuitable_source_fails_start_with_message(ros, bad, words):
    spec = SceneSpec(space=SPACE, sources=(bad,), person=None)
    with pytest.raises(Refused, match=rf"scene\.yaml:1:1.*{words}"):
        VisitorsNode(spec, Script(title="", visits=()))
