# SPDX-License-Identifier: Apache-2.0
"""Servers in bindings: timeouts, heartbeat, and outputs from feedback."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pytest

from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents_core.errors import ReadError
from bt_agents_groot.agent_export import export_agent
from bt_agents_groot.agent_import import import_agent
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.model.specs import HeartbeatSpec, SkillSpec, Timeouts
from bt_agents_language.yaml.source import Source
from bt_agents_tools.rehearsal.events import EventKind
from fake_interfaces import FakeInterfaces
from file_texts import read_agent_text, read_skills_text
from rehearsal_harness import events_of, rehearsed
from tree_harness import SYMBOLS, TREES, TreeHarness, agent

CORPUS = Path(__file__).parents[2] / "corpus"


def skills(text: str) -> dict[str, SkillSpec]:
    """Return the skills of a text, with the types of ``FakeInterfaces``."""
    return dict(
        read_skills_text(f"format: 1\n{textwrap.dedent(text)}", "s.yaml", FakeInterfaces())
    )


def test_binding_holds_server_settings_from_skills_file() -> None:
    text = (CORPUS / "skills/valid_servers.yaml").read_text(encoding="utf-8")
    read = read_skills_text(text.partition("bindings:")[0], "s.yaml")
    drive, light = (read[name].binding for name in ("drive", "light"))
    assert drive.timeouts == Timeouts(server_s=0.5, accept_s=2.0, result_s=300.0)
    assert drive.heartbeat == HeartbeatSpec(
        topic="tray/alive", type="std_msgs/msg/Empty", within_s=1.0
    )
    assert drive.feedback == {"left": "left.metres"}
    assert drive.outputs == {"feedback": "feedback", "told": "feedback.text"}
    assert light.timeouts == Timeouts(server_s=1.0, accept_s=3.0, result_s=2.0)
    assert light.heartbeat.within_s == 0.5


def test_omitted_timeouts_have_defaults() -> None:
    binding = SYMBOLS.skills["ask"].binding
    assert binding.timeouts == Timeouts(server_s=3.0, accept_s=3.0, result_s=None)
    assert SYMBOLS.skills["sound"].binding.heartbeat is None


FROM = """
skills:
  go:
    outputs: {{left: {{type: number, from: {path}}}}}
    action: {{name: go, type: known_msgs/action/Go}}
"""


def test_feedback_field_must_exist_in_known_type() -> None:
    assert skills(FROM.format(path="feedback.good.good"))["go"].binding is not None
    with pytest.raises(ReadError, match=r"5:42: error\[unknown-ros-field\].*in the feedback"):
        skills(FROM.format(path="feedback.bad"))
    with pytest.raises(ReadError, match=r"no ROS type 'other_msgs/msg/Beat'"):
        skills(
            """
            skills:
              go:
                action:
                  name: go
                  type: known_msgs/action/Go
                  heartbeat: {topic: beat, type: other_msgs/msg/Beat}
            """
        )


def test_another_robot_binds_output_to_own_feedback() -> None:
    words = """
    skills:
      go:
        outputs: {left: {type: number}}
    bindings:
      go:
        outputs: {left: feedback.good}
        action: {name: go, type: known_msgs/action/Go}
    """
    binding = skills(words)["go"].binding
    assert (binding.outputs, binding.feedback) == ({}, {"left": "good"})


def test_service_field_named_feedback_is_plain_result() -> None:
    text = """
    skills:
      go:
        outputs: {left: {type: number, from: feedback.left}}
        service: {name: go, type: a/srv/Go}
    """
    [skill] = read_skills_text(f"format: 1\n{textwrap.dedent(text)}", "s.yaml").values()
    assert skill.binding.outputs == {"left": "feedback.left"}


DRIVE = """
parallel:
  - drive: gate 12
    outputs: {metres: remaining}
  - sequence:
      - wait_for: metres < 20
      - say: Nearly there.
"""


def test_shipped_drive_reports_remaining_distance() -> None:
    told_on_the_way = ((1.0, {"remaining_m": 40.0}), (2.0, {"remaining_m": 12.0}))
    harness = TreeHarness(
        DRIVE, answers={"drive": [ScriptedReply(after_s=9.0, feedback=told_on_the_way)]}
    )
    harness.tick()
    harness.after(1.0)
    assert harness.said == []
    harness.after(1.0)
    harness.tick()
    assert harness.said == ["Nearly there."]


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
    read = read_trees(TREES)
    assert not read.broken
    robots = [SYMBOLS.skills[name].binding for name in ("say", "ask", "show", "drive")]
    assert all(binding is not None and binding.heartbeat is not None for binding in robots)


def test_raw_leaf_has_own_timeouts() -> None:
    tree = agent("service: {name: a, type: a/srv/B, timeouts: {result: 500 ms}}").tree
    assert tree.skill.binding.timeouts.result_s == 0.5
