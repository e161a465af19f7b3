# SPDX-License-Identifier: Apache-2.0
"""Several robots for one skill: which binding applies, and errors without one."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_language.files.folder_reader import binding_problems
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.model.specs import SkillSpec
from bt_agents_language.nodes.symbols import SymbolTable
from fake_interfaces import FakeInterfaces
from file_texts import read_agent_text
from tree_harness import SPACE, TREES

WORDS = """
format: 1
skills:
  ask:
    main: text
    inputs: {text: text}
    outputs: {answer: {type: text}}
"""
ROBOT = """
format: 1
robot: ROBOT
bindings:
  ask:
    outputs: {answer: good}
    action: {name: ask_ROBOT, type: PACKAGE/action/Ask, goal: {good: "${text}"}}
"""


def ask(folder: Path, *robots: tuple[str, str], prefer: str = "") -> SkillSpec:
    """Return the skill 'ask' of a folder with robots, each with the package of its types."""
    (folder / "a_words.yaml").write_text(WORDS)
    for robot, package in robots:
        text = ROBOT.replace("ROBOT", robot).replace("PACKAGE", package)
        (folder / f"{robot}.yaml").write_text(text)
    return read_skills(sorted(folder.iterdir()), FakeInterfaces(), prefer)["ask"]


def bound(skill: SkillSpec) -> str:
    return skill.binding.name if skill.binding is not None else skill.unoffered


def test_first_robot_wins_unless_another_is_preferred(tmp_path):
    robots = (("one", "known_msgs"), ("two", "known_msgs"))
    assert bound(ask(tmp_path, *robots)) == "ask_one"
    assert bound(ask(tmp_path, *robots, prefer="two")) == "ask_two"
    assert bound(ask(tmp_path, *robots, prefer="nobody")) == "ask_one"


def test_robot_with_missing_package_is_skipped(tmp_path):
    robots = (("one", "absent_msgs"), ("two", "known_msgs"))
    assert bound(ask(tmp_path, *robots)) == "ask_two"
    assert bound(ask(tmp_path, *robots, prefer="one")) == "ask_two"


@pytest.mark.parametrize(
    ("prefer", "told"),
    [
        ("", []),
        ("two, one", []),
        (
            "one,two",
            ["skill 'ask' is not done by 'one', as preferred: "
             "the ROS package 'absent_msgs' is not installed"],
        ),
        ("tow", ["no skills file binds the robot 'tow', which is preferred; did you mean 'two'?"]),
    ],
)  # fmt: skip
def test_unavailable_preferred_robot_is_reported(tmp_path, prefer, told):
    skill = ask(tmp_path, ("one", "absent_msgs"), ("two", "known_msgs"), prefer=prefer)
    assert list(binding_problems({"ask": skill}, prefer)) == told


def test_unoffered_skill_keeps_its_agents_from_bidding(tmp_path):
    skill = ask(tmp_path, ("one", "absent_msgs"))
    assert skill.unoffered == "one: the ROS package 'absent_msgs' is not installed"
    spec = read_agent_text(
        "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\ntree: {ask: Well?}\n",
        "a.yaml",
        SymbolTable(SPACE, {"ask": skill}),
    )
    assert spec.unoffered == (f"skill 'ask': {skill.unoffered}",)


def test_skill_without_binding_names_no_robot(tmp_path):
    assert bound(ask(tmp_path)) == "no robot is bound to it"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("  ask:", "  aks:", "unknown-name"),
        ("{answer: good}", "{answer: good, reply: good}", "unknown-name"),
        ("    outputs: {answer: good}\n", "", "missing-key"),
        ("known_msgs/action", "known_msgs/srv", "bad-ros-type"),
        ("goal: {good", "goal: {bad", "unknown-ros-field"),
        ("answer: good", "answer: bad", "unknown-ros-field"),
        ("${text}", "${txt}", "unknown-name"),
    ],
)
def test_invalid_binding_is_reported_at_its_position(tmp_path, old, new, expected):
    ask(tmp_path, ("one", "known_msgs"))
    path = tmp_path / "one.yaml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ReadError) as caught:
        read_skills(sorted(tmp_path.iterdir()), FakeInterfaces())
    assert f"error[{expected}]" in caught.value.lines[0]
    assert caught.value.lines[0].startswith(str(path))


def test_shipped_skills_bind_to_ros4hri_robot():
    files = sorted((TREES / "skills").iterdir())
    skills = read_skills(files, robot="ros4hri")
    assert bound(skills["say"]) == "/skill/say"
    assert bound(skills["ask"]) == "/skill/ask"
    assert skills["ask"].binding.outputs == {"answer": "answers#answer"}
    assert bound(skills["drive"]) == "/skill/navigate_to_pose"
    assert bound(skills["light"]) == "set_light"
    assert bound(read_skills(files)["say"]) == "say"
