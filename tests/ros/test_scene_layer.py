# SPDX-License-Identifier: Apache-2.0
"""The scene layer over real topics and services."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import count

import pytest
from rclpy.parameter import Parameter
from std_msgs.msg import Bool, Empty, Float64

from active_nodes import active_scene_layer
from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import MarketStatus, Run, Scene, SceneValue
from bt_agents_interfaces.srv import Analyze
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_language.model.specs import SceneChange, Script, Visit
from bt_agents_ros import qos
from scene_spaces import AGE_AND_MOOD as SPACE
from scene_spaces import source

SPEC = SceneSpec(
    space=SPACE,
    sources=(source("age"), source("mood")),
    person=source("person", "std_msgs/msg/Bool"),
)


def plain(scene: Scene) -> dict[str, float]:
    return {value.name: value.value for value in scene.values if value.origin}


class Layer:
    """A scene layer with everything around it."""

    def __init__(self, ros, script: Script | None = None) -> None:
        self.ros = ros
        numbers = count(1)
        self.runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
        self.market = ros.node.create_publisher(MarketStatus, "bt_agents/market", qos.FACT)
        self.trigger = ros.node.create_publisher(Empty, "scene_layer/trigger", qos.EVENTS)
        self.mood = ros.node.create_publisher(Float64, "sensors/mood", qos.EVENTS)
        self.person = ros.node.create_publisher(Bool, "sensors/person", qos.SENSOR)
        self.analyze_client = ros.node.create_client(
            Analyze, "scene_layer/analyze", qos_profile=qos.SERVICE
        )
        self.scenes = ros.collect(Scene, "bt_agents/scene", qos.EVENTS)
        self.live = ros.collect(Scene, "bt_agents/scene/live", qos.SENSOR)
        self.node = ros.add(active_scene_layer(SPEC, script, ids=lambda: f"s{next(numbers)}"))
        publishers = [self.runs, self.market, self.trigger]
        publishers += [self.mood, self.person] if script is None else []
        ros.until(lambda: all(p.get_subscription_count() for p in publishers))
        ros.until(lambda: self.node.count_subscribers("bt_agents/scene/live"))
        ros.turns(20)

    def analyze(self, **values) -> Analyze.Response:
        return self.ros.call(self.analyze_client, Analyze.Request(**values))

    def read_mood(self, value: float) -> None:
        """Publish a reading and wait until the layer has it."""
        self.mood.publish(Float64(data=value))
        self.ros.until(lambda: plain(self.analyze().scene).get("mood") == value)

    def run(
        self, event: int, number: int = 1, scene: Scene | None = None, epoch: str = "e"
    ) -> None:
        self.runs.publish(
            Run(epoch=epoch, round=number, event=event, scene=scene or self.scenes[-1])
        )

    def status(self, state: int = MarketStatus.IDLE, **more) -> None:
        self.market.publish(MarketStatus(epoch="e", state=state, **more))


def test_trigger_publishes_current_readings(ros):
    layer = Layer(ros)
    layer.person.publish(Bool(data=True))
    layer.read_mood(4.0)
    layer.trigger.publish(Empty())
    ros.until(lambda: layer.scenes)
    scene = layer.scenes[0]
    assert scene.scene_id == "s1"
    assert scene.person
    age, mood = scene.values
    assert (age.name, age.origin) == ("age", SceneValue.MISSING)
    assert math.isnan(age.value)
    assert (mood.name, mood.value, mood.origin) == ("mood", 4.0, SceneValue.MEASURED)
    assert mood.age_s >= 0.0


def test_hundred_consecutive_triggers_make_hundred_scenes(ros):
    layer = Layer(ros)
    for _ in range(100):
        layer.trigger.publish(Empty())
    ros.until(lambda: len(layer.scenes) >= 100)
    ros.turns()
    assert [scene.scene_id for scene in layer.scenes] == [f"s{n}" for n in range(1, 101)]


def test_caller_or_script_can_mark_scene_urgent(ros):
    visit = Visit(label="an alarm", person=False, values={"mood": 2.0}, urgent=True)
    layer = Layer(ros, Script(title="", visits=(visit,)))
    assert layer.analyze(urgent=True, announce=True).scene.urgent
    assert not layer.analyze(announce=True).scene.urgent
    ros.node.create_subscription(Scene, "bt_agents/scene", lambda _: None, qos.EVENTS)
    layer.status(agents=1)
    ros.until(lambda: len(layer.scenes) == 3)
    assert [scene.urgent for scene in layer.scenes] == [True, False, True]


def test_late_market_receives_only_last_scene(ros):
    layer = Layer(ros)
    for _ in range(3):
        layer.trigger.publish(Empty())
    ros.until(lambda: len(layer.scenes) == 3)
    late = ros.collect(Scene, "bt_agents/scene", qos.FACT)
    ros.until(lambda: late)
    ros.turns()
    assert [scene.scene_id for scene in late] == ["s3"]


def test_given_values_make_a_scene_if_announced(ros):
    layer = Layer(ros)
    answer = layer.analyze(
        label="child", names=["age"], values=[1.0], person=Analyze.Request.PRESENT, announce=True
    )
    assert (answer.accepted, answer.code) == (True, "")
    ros.until(lambda: layer.scenes)
    assert str(answer.scene) == str(layer.scenes[0])
    assert (answer.scene.label, answer.scene.person) == ("child", True)
    assert plain(answer.scene) == {"age": 1.0}
    assert answer.scene.values[0].origin == SceneValue.GIVEN
    unannounced = layer.analyze(names=["mood"], values=[2.0], announce=False)
    assert unannounced.accepted
    assert unannounced.scene.scene_id == answer.scene.scene_id
    assert plain(unannounced.scene) == {"age": 1.0, "mood": 2.0}
    ros.turns()
    assert len(layer.scenes) == 1


def test_values_without_any_scene_are_refused_and_dropped(ros):
    layer = Layer(ros)
    for given in ({"names": ["age"], "values": [1.0]}, {"person": Analyze.Request.PRESENT}):
        answer = layer.analyze(**given, announce=False)
        assert (answer.accepted, answer.code) == (False, "NOT_RUNNING")
        assert "bt-agents trigger" in answer.message
    answer = layer.analyze(announce=False)
    assert (answer.accepted, plain(answer.scene)) == (True, {})


def test_a_hostile_analysis_changes_nothing(ros):
    layer = Layer(ros)
    layer.analyze(names=["mood"], values=[3.0], announce=True)
    for fields, code in (
        ({"names": ["mod"], "values": [1.0]}, "UNKNOWN_PARAMETER"),
        ({"names": [], "values": [1.0]}, "WRONG_LENGTH"),
        ({"names": ["mood", "mood"], "values": [1.0, 2.0]}, "DUPLICATE_PARAMETER"),
        ({"names": ["mood"], "values": [1.0], "person": 7}, "UNKNOWN_CHOICE"),
    ):
        refused = layer.analyze(**fields, announce=True)
        assert (refused.accepted, refused.code) == (False, code), fields
        assert refused.message
    assert plain(layer.analyze().scene) == {"mood": 3.0}
    ros.turns()
    assert len(layer.scenes) == 1


def test_live_scene_is_published_throughout_run(ros):
    layer = Layer(ros)
    layer.read_mood(4.0)
    layer.trigger.publish(Empty())
    ros.until(lambda: layer.scenes)
    ros.turns()
    assert layer.live == []
    layer.run(Run.STARTED)
    ros.until(lambda: len(layer.live) >= 3)
    assert {scene.scene_id for scene in layer.live} == {"s1"}
    layer.run(Run.CANCELLING)
    layer.run(Run.ENDED)
    ros.turns()
    published = len(layer.live)
    layer.read_mood(1.0)
    ros.turns(40)
    assert len(layer.live) == published

    layer.run(Run.STARTED, 2)
    ros.until(lambda: len(layer.live) > published)
    layer.market.publish(MarketStatus(epoch="new"))
    ros.turns()
    published = len(layer.live)
    ros.turns(40)
    assert len(layer.live) == published, "the market of the run is gone"


def test_change_during_run_is_published_immediately(ros):
    layer = Layer(ros)
    layer.analyze(names=["mood"], values=[4.0], announce=True)
    ros.until(lambda: layer.scenes)
    [slow] = layer.node.set_parameters([Parameter("live_rate", value=1.0)])
    assert slow.successful
    layer.run(Run.STARTED)
    ros.until(lambda: layer.live)
    layer.node._live_timer.cancel()  # no regular live scene
    layer.mood.publish(Float64(data=2.0))
    ros.until(lambda: plain(layer.live[-1]) == {"mood": 2.0})
    layer.analyze(names=["mood"], values=[5.0])
    ros.until(lambda: plain(layer.live[-1]) == {"mood": 5.0})


def test_scene_layer_survives_run_with_malformed_scene(ros):
    layer = Layer(ros)
    layer.run(Run.STARTED, scene=Scene(scene_id="x", values=[SceneValue(name="mod")]))
    layer.run(Run.STARTED, scene=Scene())
    ros.turns()
    assert layer.live == []
    assert layer.analyze().accepted


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (source("mood", "no_msgs/msg/Face"), "apt install ros-jazzy-no-msgs"),
        (source("mood", field="msg.dta"), "did you mean data?"),
    ],
)
def test_uninstalled_source_type_fails_start_with_message(ros, bad, words):
    with pytest.raises(Refused, match=words.replace("?", r"\?")):
        active_scene_layer(SceneSpec(space=SPACE, sources=(bad,), person=None))


def visit(label: str, mood: float, *changes: SceneChange) -> Visit:
    return Visit(label=label, person=True, values={"mood": mood}, changes=changes)


def test_script_plays_visits_in_sequence(ros):
    change = SceneChange(after_s=0.0, values={"mood": 1.0}, person=False)
    anna = [replace(visit(label, 2.0), name="anna") for label in "bc"]
    script = Script(title="", visits=(visit("a", 4.0, change), *anna))
    layer = Layer(ros, script=script)
    ros.turns(20)
    assert layer.scenes == []
    layer.status(agents=0)
    ros.turns(20)
    assert layer.scenes == []
    layer.status(agents=1)
    # One node subscribes to scenes and publishes the status here, as in a market.
    ros.until(lambda: len(layer.scenes) == 1)
    assert (layer.scenes[0].label, plain(layer.scenes[0])) == ("a", {"mood": 4.0})
    layer.status(MarketStatus.RUNNING, round=1, agents=1)
    layer.run(Run.STARTED)
    ros.until(lambda: layer.live and plain(layer.live[-1]) == {"mood": 1.0})
    assert not layer.live[-1].person
    layer.run(Run.ENDED)
    layer.status(round=1, agents=1, finished_scene_id="s1")
    ros.until(lambda: len(layer.scenes) == 2)
    assert (layer.scenes[1].label, plain(layer.scenes[1])) == ("b", {"mood": 2.0})
    layer.status(round=2, agents=1, finished_scene_id="s2")
    ros.until(lambda: len(layer.scenes) == 3)
    visits = [(scene.person_id, scene.visits) for scene in layer.scenes]
    assert visits == [("", 0), ("anna", 1), ("anna", 2)]
    layer.status(round=3, agents=1, finished_scene_id="s3")
    ros.turns(40)
    assert len(layer.scenes) == 3


def test_latest_request_ids_are_answered_once(ros):
    layer = Layer(ros)

    def announced(request_id: str) -> str:
        return layer.analyze(request_id=request_id, announce=True).scene.scene_id

    assert [announced(request_id) for request_id in ("a", "a", "b")] == ["s1", "s1", "s2"]
    for number in range(99):
        announced(f"r{number}")
    assert announced("b") == "s2"
    assert announced("a") == "s102"
    ros.until(lambda: len(layer.scenes) == 102)
