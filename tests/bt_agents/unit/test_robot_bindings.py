# SPDX-License-Identifier: Apache-2.0
"""The shipped bindings of other robots: requests to their servers, and their failures."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents_core.field_types import Plain
from bt_agents_core.scene import Scene
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.nodes.symbols import SymbolTable
from defined_interfaces import DefinedInterfaces
from file_texts import read_agent_text
from tree_harness import SPACE, TREES, TreeHarness, scene, started

PLACES = """
format: 1
places:
  gate 12: {x: 3.5 m, y: -2 m, heading: 90 deg}
  lounge: {x: 0, y: 1, frame: upstairs}
"""
ANNA = replace(scene(age=3, familiarity=3, mood=3), person_id="anna")
CODE = {"error_code": 4, "error_msg": "a call of higher priority"}

Play = Callable[..., TreeHarness]


def read(tree: str, robot: str, folder: Path) -> AgentSpec:
    """Return an agent with a robot's bindings, checked against the definitions of its types."""
    skills = read_skills(sorted(folder.iterdir()), DefinedInterfaces(), robot)
    text = "format: 1\nagent: guide\nprofile: {age: 3, familiarity: 3, mood: 3}\ntree:\n  "
    return read_agent_text(f"{text}{tree}\n", "guide.yaml", SymbolTable(SPACE, skills))


@pytest.fixture
def skills(tmp_path: Path) -> Path:
    """The shipped skills, and the places of a site."""
    shutil.copytree(TREES / "skills", tmp_path / "skills")
    (tmp_path / "skills" / "places.yaml").write_text(PLACES)
    return tmp_path / "skills"


@pytest.fixture
def play(skills: Path) -> Play:
    """Ticks a tree of one leaf once, on a given robot and with a given answer."""

    def play(
        tree: str, robot: str = "ros4hri", awarded: Scene = ANNA, **reply: Any
    ) -> TreeHarness:
        spec = read(tree, robot, skills)
        binding = spec.tree.skill.binding if spec.tree.skill is not None else None
        assert binding is not None
        answers = {binding.name: [ScriptedReply(**reply)]}
        return started(spec.tree, answers=answers, awarded=awarded)

    return play


def goal(harness: TreeHarness) -> tuple[str, Mapping[str, Any]]:
    [sent] = harness.environment.goals
    return sent.goal.name, sent.goal.fields


FINE: Mapping[str, Plain] = {"result": {"error_code": 0, "error_msg": ""}}
LEAVES = {
    "say": ("say: Hello.", "/skill/say", {"input": "Hello."}),
    "ask": ("ask: Where to?", "/skill/ask", {"question": "Where to?"}),
    "chat": (
        "chat: {role: guide, text: Welcome., configuration: short}",
        "/skill/chat",
        {
            "role": {"name": "guide", "configuration": "short"},
            "initiate": True,
            "initial_input": "Welcome.",
        },
    ),
    "motion": ("motion: wave", "/skill/replay_motion", {"name": "wave"}),
    "drive": ("drive: gate 12", "/skill/navigate_to_pose", {}),
}


@pytest.mark.parametrize(("tree", "name", "fields"), LEAVES.values(), ids=LEAVES)
def test_ros4hri_goal_carries_caller_priority_and_person(tree, name, fields, play):
    sent, told = goal(play(tree))
    assert sent == name
    assert told["meta"] == {"caller": "/agents", "priority": 128}
    assert told.get("person_id", "anna") == "anna"
    assert {key: told[key] for key in fields} == fields


SOUND = {"sound": -3, "command": 1, "volume": 1.0, "arg": "Hello."}


@pytest.mark.parametrize(
    ("robot", "server", "fields"),
    [
        ("audio_common", "say", {"text": "Hello."}),
        ("sound_play", "sound_play", {"sound_request": SOUND}),
    ],
)
def test_public_speech_nodes_get_the_text(robot, server, fields, play):
    harness = play("say: Hello.", robot)
    assert goal(harness) == (server, fields)
    assert harness.after(0.1) == "succeeded"


def test_urgent_scene_raises_skill_priority(play):
    _, told = goal(play("say: Fire!", awarded=replace(ANNA, urgent=True)))
    assert told["meta"] == {"caller": "/agents", "priority": 192}


def test_skill_addresses_person_present_when_it_starts(skills):
    spec = read("{sequence: [{say: Hello?}, {wait: 1 s}, {say: Hello.}]}", "ros4hri", skills)
    nobody = replace(ANNA, person=False, person_id="")
    answers = {"/skill/say": [ScriptedReply(result=FINE)]}
    harness = started(spec.tree, answers=answers, awarded=nobody)
    harness.live = replace(ANNA, person_id="ben")
    assert harness.after(1.0) == "succeeded"
    assert [sent.goal.fields["person_id"] for sent in harness.environment.goals] == ["", "ben"]


@pytest.mark.parametrize(("tree", "name", "_fields"), LEAVES.values(), ids=LEAVES)
def test_result_error_code_fails_succeeded_goal(tree, name, _fields, play):
    harness = play(tree, result={"result": CODE})
    assert harness.outcome == "failed"
    assert harness.root.feedback_message == f"{name} failed: code 4: a call of higher priority"


@pytest.mark.parametrize(
    ("result", "reason"),
    [
        (CODE, "code 4: a call of higher priority"),
        ({"error_code": 255, "error_msg": ""}, "code 255"),
        ({"error_code": 0, "error_msg": ""}, "its server gave up and says nothing about why"),
    ],
)
def test_aborted_goal_reports_its_error_code(result, reason, play):
    harness = play("say: Hello.", result={"result": result}, state=GoalState.ABORTED)
    assert harness.outcome == "failed"
    assert harness.root.feedback_message == f"/skill/say aborted: {reason}"


def test_raw_nodes_support_run_fields_and_error_codes(play):
    harness = play(
        "service: {name: note, type: std_srvs/srv/SetBool, request: {data: true},\n"
        "    error_code: {field: success, success: 1, message: message}}",
        "",
        result={"success": False, "message": "no paper"},
    )
    assert harness.outcome == "failed"
    assert harness.root.feedback_message == "note failed: code False: no paper"
    message = "publish: {topic: who, type: std_msgs/msg/String, message: {data: '${run.agent}'}}"
    [sent] = play(message, "").environment.published
    assert sent.fields == {"data": "a"}


def test_ask_fails_when_json_lacks_the_answer(play):
    harness = play("ask: Where to?", result={**FINE, "answers": "{}"})
    assert harness.outcome == "failed"
    assert "result.answers#answer" in harness.root.feedback_message
    harness = play("ask: Where to?", result={**FINE, "answers": '{"answer": "gate 12"}'})
    assert harness.outcome == "succeeded"
    assert harness.run.scope.lookup("answer") == "gate 12"


@pytest.mark.parametrize("robot", ["nav2", "ros4hri"])
def test_drive_sends_map_pose_of_named_place(robot, play):
    gate, lounge = (goal(play(f"drive: {to}", robot))[1]["pose"] for to in ("gate 12", "lounge"))
    assert gate["header"] == {"frame_id": "map"}
    assert gate["pose"]["position"] == {"x": 3.5, "y": -2.0}
    assert gate["pose"]["orientation"] == pytest.approx({"z": math.sqrt(0.5), "w": math.sqrt(0.5)})
    assert lounge["header"] == {"frame_id": "upstairs"}
    assert lounge["pose"]["orientation"] == {"z": 0.0, "w": 1.0}


def test_nav2_reports_remaining_distance_and_error_code(play):
    harness = play(
        "drive: gate 12",
        "nav2",
        result={"error_code": 9003, "error_msg": "the goal is blocked"},
        after_s=5.0,
        feedback=((0.0, {"distance_remaining": 7.5}),),
    )
    assert harness.run.scope.lookup("remaining") == 7.5
    assert harness.after(5.0) == "failed"
    expected = "navigate_to_pose failed: code 9003: the goal is blocked"
    assert harness.root.feedback_message == expected


def test_undeclared_place_fails_leaf_and_lists_known_places(play, skills):
    harness = play("drive: gate 13", "nav2")
    assert harness.outcome == "failed"
    assert harness.environment.goals == []
    found = "there is no place 'gate 13'; there are gate 12 and lounge"
    assert found in harness.root.feedback_message
    (skills / "places.yaml").unlink()
    harness = play("drive: gate 13", "nav2")
    assert "no skills file has the key 'places'" in harness.root.feedback_message


def test_first_preferred_robot_offering_skill_is_bound(skills):
    def bound(robot: str) -> dict[str, str]:
        found = read_skills(sorted(skills.iterdir()), DefinedInterfaces(), robot)
        return {
            name: one.binding.name
            for name, one in found.items()
            if one.binding is not None and name in ("say", "drive", "light")
        }

    both = {"say": "/skill/say", "light": "set_light"}
    assert bound("nav2, ros4hri") == {**both, "drive": "navigate_to_pose"}
    assert bound("ros4hri,nav2") == {**both, "drive": "/skill/navigate_to_pose"}
    assert bound("") == {"say": "say", "light": "set_light", "drive": "drive"}
