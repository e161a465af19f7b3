# SPDX-License-Identifier: Apache-2.0
"""A robot with ROS4HRI topics and skills and with Nav2, using types with the same fields."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import Bool, Empty, String

from bt_agents_core.feedback import FeedbackKind
from bt_agents_interfaces.msg import (
    EngagementLevel,
    Expression,
    PersonIds,
    Run,
    Scene,
    StatusChange,
    TreeStatus,
)
from bt_agents_ros import qos
from compiled_types import PACKAGE, compiled_types
from scripted_server import Script, ScriptedServer
from tree_harness import TREES
from whole_system import System

AGENT = """
format: 1
agent: {name}
title: {name}
description: d
profile: {{age: 3, familiarity: {familiarity}, mood: 3}}
requires: scene.person
tree: {tree}
"""
RULE = "feedback: [{when: mood.change <= -1, for: 0 s, give: negative, then: cancel}]"
PLACES = "format: 1\nplaces:\n  gate 12: {x: 3.5 m, y: -2 m, heading: 180 deg}\n"
HRI = {
    "hri_msgs/msg/IdsList": "bt_agents_interfaces/msg/PersonIds",
    "hri_msgs/msg/": "bt_agents_interfaces/msg/",
}
COMPILED = {
    "communication_skills/action/Say": f"{PACKAGE}/action/Say",
    "nav2_msgs/action/NavigateToPose": f"{PACKAGE}/action/NavigateToPose",
}


@pytest.fixture(scope="module")
def prefix() -> Iterator[Path]:
    with compiled_types() as prefix:
        yield prefix


@pytest.fixture
def types(prefix: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The actions of the robot, installed for the duration of the test."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    from py_trees_ros_interfaces import action

    return action


def shipped(path: Path, types: dict[str, str]) -> str:
    """Return a shipped file with installed types instead of those that it names."""
    text = path.read_text(encoding="utf-8")
    for name, installed in types.items():
        assert name in text or types is COMPILED
        text = text.replace(name, installed)
    return text


class Site:
    """The whole system with the shipped scene and skills of ROS4HRI and Nav2, and its sensors."""

    def __init__(self, ros: Any, folder: Path, **trees: str) -> None:
        self.ros = ros
        (folder / "agents").mkdir()
        (folder / "skills").mkdir()
        for path in sorted((TREES / "skills").iterdir()):
            (folder / "skills" / path.name).write_text(shipped(path, COMPILED))
        (folder / "skills" / "places.yaml").write_text(PLACES)
        (folder / "scene.yaml").write_text(shipped(TREES / "scenes" / "ros4hri.yaml", HRI))
        for number, (name, tree) in enumerate(trees.items()):
            text = AGENT.format(name=name, tree=tree, familiarity=5 - number)
            (folder / "agents" / f"{name}.yaml").write_text(text)
        self.system = System(ros, folder, "ros4hri, nav2")
        self.live = ros.collect(Scene, "bt_agents/scene/live", qos.SENSOR)
        self.statuses = ros.collect(TreeStatus, "agents/status", qos.EVENTS)
        self._trigger = ros.node.create_publisher(Empty, "scene_layer/trigger", qos.EVENTS)
        self._sensors: dict[str, tuple[Any, Any]] = {}
        for topic, message in (("face_id", String(data="f")), ("anonymous", Bool(data=False))):
            name = f"/humans/persons/anna/{topic}"
            ros.node.create_publisher(type(message), name, qos.FACT).publish(message)

    def sees(self, tracked: list[str], level: int, word: str) -> None:
        """Publish this from now on, as periodically as the nodes of ROS4HRI."""
        for topic, message in (
            ("persons/tracked", PersonIds(ids=tracked)),
            ("persons/anna/engagement_status", EngagementLevel(level=level)),
            ("faces/f/expression", Expression(expression=word, confidence=0.9)),
        ):
            publisher = self._sensors[topic][0] if topic in self._sensors else None
            publisher = publisher or self.ros.node.create_publisher(
                type(message), f"/humans/{topic}", qos.SENSOR
            )
            self._sensors[topic] = (publisher, message)

    def until(self, condition: Any) -> None:
        def held() -> Any:
            for publisher, message in self._sensors.values():
                publisher.publish(message)
            return condition()

        self.ros.until(held)

    def scene(self) -> Scene:
        return self.system.analyze(announce=False, person=0).scene

    def mood(self, scene: Scene) -> float:
        [value] = [one.value for one in scene.values if one.name == "mood"]
        return float(value)

    def begin(self) -> None:
        """Make anna engaged and happy, and trigger a scene."""
        self.sees(["anna"], EngagementLevel.ENGAGED, "happy")
        self.until(lambda: self.mood(self.scene()) > 4.0)
        self.ros.until(self._trigger.get_subscription_count)
        self._trigger.publish(Empty())


def test_interaction_follows_person_from_arrival_to_departure(
    ros: Any, tmp_path: Path, types: Any
):
    mouth = ScriptedServer(ros, "/skill/say", kind=types.Say, script=Script(finish_s=None))
    site = Site(ros, tmp_path, joker=f"{{say: Hello.}}\n{RULE}", quiet="{wait: 60 s}")

    site.sees(["anna"], EngagementLevel.DISENGAGED, "happy")
    site.until(lambda: site.scene().person_id == "anna")
    site.begin()

    site.until(lambda: mouth.goals)
    told = mouth.goals[0].request
    assert (told.input, told.person_id, told.group_id) == ("Hello.", "anna", "")
    assert (told.meta.caller, told.meta.priority) == ("/agents", 128)
    site.until(lambda: site.live and site.live[-1].person_id == "anna")

    site.sees(["anna"], EngagementLevel.ENGAGED, "sad")
    site.until(lambda: site.system.feedback_given)
    given = site.system.feedback_given[0]
    assert (given.agent, given.kind) == ("joker", int(FeedbackKind.NEGATIVE))
    assert given.reason.startswith("mood.change <= -1 held 0 s: mood 4.")
    assert given.leaf == "tree"
    site.until(lambda: mouth.goals[0].outcome == "cancelled")
    site.until(lambda: sum(run.event == Run.STARTED for run in site.system.runs) == 2)
    [stopped] = [run for run in site.system.runs if run.event == Run.ENDED]
    assert (stopped.agent, stopped.outcome) == ("joker", Run.CANCELLED)

    site.sees([], EngagementLevel.DISENGAGED, "")
    site.until(lambda: not site.live[-1].person)
    assert site.live[-1].persons == 0
    assert len(site.system.feedback_given) == 1


def test_drive_uses_nav2_and_reports_remaining_distance(ros: Any, tmp_path: Path, types: Any):
    script = Script(finish_s=None, feedback=((0.0, {"distance_remaining": 7.5}),), aborts=True)
    script.result = {"error_code": 9003, "error_msg": "the goal is blocked"}
    base = ScriptedServer(ros, "navigate_to_pose", kind=types.NavigateToPose, script=script)
    near = "{sequence: [{wait_for: remaining < 8}, {wait: 60 s, name: near}]}"
    tree = f"{{parallel: [{{drive: gate 12}}, {near}]}}"
    site = Site(ros, tmp_path, carrier=tree)
    site.begin()
    site.until(lambda: base.goals)
    pose = base.goals[0].request.pose
    assert pose.header.frame_id == "map"
    assert (pose.pose.position.x, pose.pose.position.y) == (3.5, -2.0)
    turned = pose.pose.orientation
    assert (turned.z, turned.w) == (1.0, pytest.approx(0.0, abs=1e-9))
    site.until(lambda: any(one.name == "near" for s in site.statuses for one in s.changes))
    base.goals[0].finish()

    def failures() -> list[str]:
        changes = [change for status in site.statuses for change in status.changes]
        return [one.message for one in changes if one.status == StatusChange.FAILURE]

    site.until(failures)
    assert failures()[0] == "navigate_to_pose aborted: code 9003: the goal is blocked"
