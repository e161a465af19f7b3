# SPDX-License-Identifier: Apache-2.0
"""Skills files, and the specs that they become."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.model.specs import MapValue, Reference
from fake_interfaces import FakeInterfaces
from file_texts import read_skills_text
from tree_harness import TREES

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


def test_unknown_ros_fields_are_positioned_errors():
    with pytest.raises(ReadError) as error:
        read_skills_text(ASK.replace("goal: {good", "goal: {bad"), "s.yaml", FakeInterfaces())
    assert [line.split(": ")[0] for line in error.value.lines] == [
        "s.yaml:12:7",
        "s.yaml:13:20",
        "s.yaml:17:14",
    ]
    assert all("unknown-ros-field" in line for line in error.value.lines)


def test_skill_condition_sees_only_the_result():
    with pytest.raises(ReadError, match=r"18:21: error\[unknown-name\]"):
        read_skills_text(ASK.replace("result.good !=", "wait !="), "s.yaml")
