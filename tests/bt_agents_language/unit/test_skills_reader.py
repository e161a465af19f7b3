# SPDX-License-Identifier: Apache-2.0
"""Skills files: what they become, several robots for a skill, and settings of servers."""

from __future__ import annotations

from pathlib import Path

import pytest

from agent_texts import agent_of, refusal
from bt_agents_core.errors import ReadError
from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_groot.agent_export import export_agent
from bt_agents_groot.agent_import import import_agent
from bt_agents_language.files.folder_reader import binding_problems
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.model.specs import (
    Binding,
    HeartbeatSpec,
    MapValue,
    Reference,
    SkillSpec,
    Timeouts,
)
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.source import Source
from bt_agents_tools.rehearsal.events import EventKind
from fake_interfaces import FakeInterfaces
from file_texts import read_agent_text, read_skills_text
from rehearsal_harness import events_of, rehearsed
from tree_harness import SPACE, SYMBOLS, TREES, agent

ASK = """\
format: 1
skills:
  ask:
    description: Ask.
    main: text
    inputs:
      text: {type: text, description: the question}
      choices: {type: any, default: [yes, 1]}
      wait: {type: duration, default: 10 s}
      how: text
    outputs:
      answer: {type: text}
      code: {from: details.code}
    action:
      name: ask
      type: known_msgs/action/Ask
      goal: {good: "${text}"}
      succeed_when: result.good != ''
"""


def test_skill_has_inputs_outputs_and_binding():
    skill = read_skills_text(ASK, "s.yaml")["ask"]
    assert (skill.name, skill.description, skill.main) == ("ask", "Ask.", "text")
    assert [(one.name, one.type, one.required, one.default) for one in skill.inputs] == [
        ("text", FieldType.TEXT, True, None),
        ("choices", FieldType.ANY, False, ("yes", 1)),
        ("wait", FieldType.DURATION, False, 10.0),
        ("how", FieldType.TEXT, True, None),
    ]
    assert [(one.name, one.type) for one in skill.outputs] == [
        ("answer", FieldType.TEXT),
        ("code", FieldType.ANY),
    ]
    binding = skill.binding
    assert (binding.kind, binding.name) == (BindingKind.ACTION, "ask")
    assert binding.fields == MapValue(items={"good": Reference(name="text")})
    assert binding.outputs == {"answer": "answer", "code": "details.code"}
    assert binding.succeed_when.text == "result.good != ''"
    assert str(skill.position) == "s.yaml:3:3"


def test_shipped_skills_cover_every_kind_of_interface():
    skills = read_skills([TREES / "skills" / "robot.yaml"])
    assert {skill.binding.kind for skill in skills.values()} == set(BindingKind)


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
    spec = agent_of("tree: {ask: Well?}\n", SymbolTable(SPACE, {"ask": skill}))
    assert spec.unoffered == (f"skill 'ask': {skill.unoffered}",)


def test_skill_without_binding_names_no_robot(tmp_path):
    assert bound(ask(tmp_path)) == "no robot is bound to it"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
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
    (first, *_) = refusal(read_skills, sorted(tmp_path.iterdir()), FakeInterfaces()).diagnostics
    assert (first.code, first.position.file) == (expected, str(path))


CORPUS = Path(__file__).parents[2] / "corpus"
KNOWN = FakeInterfaces()


def go(binding: str, outputs: str = "", interfaces: FakeInterfaces | None = KNOWN) -> Binding:
    """Return the binding of the skill 'go'."""
    text = f"format: 1\nskills: {{go: {{outputs: {{{outputs}}}, {binding}}}}}\n"
    return read_skills_text(text, "s.yaml", interfaces)["go"].binding


def test_binding_holds_server_settings_from_skills_file() -> None:
    text = (CORPUS / "skills/valid_servers.yaml").read_text(encoding="utf-8")
    read = read_skills_text(text.partition("bindings:")[0], "s.yaml")
    drive, light = (read[name].binding for name in ("drive", "light"))
    assert drive.timeouts == Timeouts(server_s=0.5, accept_s=2.0, result_s=300.0)
    beat = HeartbeatSpec(topic="tray/alive", type="std_msgs/msg/Empty", within_s=1.0)
    assert drive.heartbeat == beat
    outputs = {"feedback": "feedback", "told": "feedback.text"}
    assert (drive.feedback, drive.outputs) == ({"left": "left.metres"}, outputs)
    assert light.timeouts == Timeouts(server_s=1.0, accept_s=3.0, result_s=2.0)
    assert light.heartbeat.within_s == 0.5


def test_omitted_timeouts_have_defaults() -> None:
    binding = SYMBOLS.skills["ask"].binding
    assert binding.timeouts == Timeouts(server_s=3.0, accept_s=3.0, result_s=None)
    assert SYMBOLS.skills["sound"].binding.heartbeat is None


ACTION = "action: {name: go, type: known_msgs/action/Go}"
LEFT = "left: {type: number, from: feedback.%s}"


def test_feedback_field_must_exist_in_known_type() -> None:
    assert go(ACTION, LEFT % "good.good").feedback == {"left": "good.good"}
    with pytest.raises(ReadError, match=r"2:52: error\[unknown-ros-field\].*in the feedback"):
        go(ACTION, LEFT % "bad")
    heartbeat = "heartbeat: {topic: beat, type: other_msgs/msg/Beat}"
    with pytest.raises(ReadError, match=r"no ROS type 'other_msgs/msg/Beat'"):
        go(ACTION.replace("}", f", {heartbeat}}}"))


class Texts(FakeInterfaces):
    """Each field is a text."""

    def field_type(self, *_: object) -> FieldType:
        return FieldType.TEXT


def test_input_of_other_type_cannot_fill_field() -> None:
    inputs, goal = "inputs: {turn: angle}, ", ", goal: {good: '${turn}'}}"
    problem = "known_msgs/action/Go: 'good': expected a text, but this is an angle"
    with pytest.raises(ReadError, match=problem):
        go(inputs + ACTION.replace("}", goal), interfaces=Texts())
    go(inputs + ACTION.replace("}", goal.replace("$", "to $")), interfaces=Texts())


BOUND = f"""
format: 1
skills: {{go: {{outputs: {{left: {{type: number}}}}}}}}
bindings: {{go: {{outputs: {{left: feedback.good}}, {ACTION}}}}}
"""


def test_output_has_the_type_of_its_field() -> None:
    problem = "output 'left': expected a number, but 'good' is a text"
    with pytest.raises(ReadError, match=problem):
        go(ACTION, LEFT % "good", Texts())
    with pytest.raises(ReadError, match=problem):
        read_skills_text(BOUND, "s.yaml", Texts())
    go(ACTION, LEFT.replace("number", "text") % "good", Texts())


def test_another_robot_binds_output_to_own_feedback() -> None:
    binding = read_skills_text(BOUND, "s.yaml", KNOWN)["go"].binding
    assert (binding.outputs, binding.feedback) == ({}, {"left": "good"})


def test_topic_binds_a_skill_with_outputs() -> None:
    topic = "topic: {name: go, type: known_msgs/msg/Go}"
    for outputs in ("", "outputs: {left: left}, "):
        with pytest.raises(ReadError, match="nothing"):
            read_skills_text(
                BOUND.replace("outputs: {left: feedback.good}, " + ACTION, outputs + topic),
                "s.yaml",
            )
    bound = BOUND.replace("feedback.good", "nothing").replace(ACTION, topic)
    assert read_skills_text(bound, "s.yaml")["go"].binding is not None


def test_service_field_named_feedback_is_plain_result() -> None:
    binding = go("service: {name: go, type: a/srv/Go}", LEFT % "left", None)
    assert binding.outputs == {"left": "feedback.left"}


DRIVE = """
parallel:
  - drive: gate 12
    outputs: {metres: remaining}
  - sequence:
      - wait_for: metres < 20
      - say: Nearly there.
"""


def test_rehearsal_gives_only_declared_feedback_from_start() -> None:
    given = rehearsed(DRIVE, "answers: {drive: {outputs: {remaining: 5 m}}}")
    assert events_of(given, EventKind.BEGINS) == [(0.0, "drive"), (0.0, "say")]
    nothing = rehearsed("sequence:\n  - drive: gate 12\n  - log: ${remaining}")
    assert nothing.outcome is not None
    assert "'remaining' has no value" in nothing.message


def test_never_ending_skill_times_out_in_rehearsal() -> None:
    result = rehearsed("say: Hello.", "answers: {say: {ends: never}}")
    assert result.message.startswith("say timed out: no result within 120 s")


def test_server_keys_survive_groot_round_trip() -> None:
    path = CORPUS / "agents/valid_servers.yaml"
    source = Source("a.yaml", path.read_text(encoding="utf-8"))
    before = read_agent_text(source.text, "a.yaml", SYMBOLS)
    exported = export_agent(source, SYMBOLS)
    back = import_agent(Source("t.xml", exported.text), "a", SYMBOLS)
    after = read_agent_text(back.text, "a.yaml", SYMBOLS)
    for one, other in zip(before.tree.children, after.tree.children, strict=True):
        assert one.fields.keys() == other.fields.keys()
        if one.skill is not None:
            assert other.skill.binding == one.skill.binding


def test_every_shipped_action_has_heartbeat() -> None:
    robots = [SYMBOLS.skills[name].binding for name in ("say", "ask", "show", "drive")]
    assert all(binding.heartbeat is not None for binding in robots)


def test_raw_leaf_has_own_timeouts() -> None:
    tree = agent("service: {name: a, type: a/srv/B, timeouts: {result: 500 ms}}").tree
    assert tree.skill.binding.timeouts.result_s == 0.5
