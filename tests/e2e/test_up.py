# SPDX-License-Identifier: Apache-2.0
"""A system that is kept running and spoken to from other processes."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from programs import Program

pytestmark = pytest.mark.e2e

Start = Callable[..., Program]
Ask = Callable[..., str]


def test_a_system_is_triggered_explained_tuned_by_feedback_cancelled_and_remembers(
    start: Start, ask: Ask
) -> None:
    up = start("up", "--no-voice")
    up.until("ready")
    decision = ask("trigger", "age=4.5", "familiarity=1", "mood=3", "--label", "Mrs Smith")
    assert "attentive_guide" in decision
    up.until("attentive_guide starts")
    assert "running: " in ask("status")
    up.until("says: Hello")
    assert ask("cancel") != ""
    up.until("attentive_guide cancelled")
    why = ask("why")
    assert "Mrs Smith" in why
    assert re.search(r"attentive_guide +1 = |attentive_guide 1", why)
    moved = ask("feedback", "positive", "--reason", "kind")
    assert re.search(r"attentive_guide: age 4 → 4\.1.*\(revision 1\)", moved)
    assert "age 4.1" in ask("status")
    code, _ = up.stop()
    assert code == 0, up.output

    again = start("up", "--no-voice")
    again.until("ready")
    assert re.search(r"attentive_guide +age 4\.1,.*revision 1", ask("status"))
    code, _ = again.stop()
    assert code == 0


def test_what_is_wrong_on_the_command_line_is_said_in_one_line(start: Start, ask: Ask) -> None:
    up = start("up", "--no-voice")
    up.until("ready")
    assert "NOT_FINITE" in ask("trigger", "age=nan", code=1)
    assert "OUT_OF_RANGE" in ask("trigger", "age=9", code=1)
    assert "UNKNOWN_PARAMETER" in ask("trigger", "size=3", code=1)
    assert "name=number" in ask("trigger", "age:3", code=2)
    assert "no decision yet" in ask("why", code=1)
    assert "error" in ask("cancel", code=1)
    assert "error" in ask("feedback", "positive", code=1)
    assert "idle" in ask("status")
    assert "Traceback" not in up.output


def test_asking_without_a_running_system_says_how_to_start_one(ask: Ask) -> None:
    said = ask("status", code=1)
    assert "bt-agents up" in said


def test_a_broken_agent_file_is_listed_with_positions_and_the_others_run(
    start: Start, ask: Ask, trees: Path
) -> None:
    broken = trees / "agents" / "playful_companion.yaml"
    text = broken.read_text()
    broken.write_text(text.replace("sequence:", "sequenze:").replace("profile:", "profle:"))
    up = start("up", str(trees), "--no-voice")
    up.until("ready")
    assert re.search(r"playful_companion\.yaml:\d+:\d+: error\[", up.output)
    assert up.output.count("error[") >= 2
    assert "winner" not in ask("trigger", "age=1", "familiarity=1", "mood=4")
    status = ask("status")
    assert "attentive_guide" in status
    assert "problem: " in status
    assert up.stop()[0] == 0


def test_an_unknown_ros_type_is_an_error_at_load_that_names_it(start: Start, trees: Path) -> None:
    agent = trees / "agents" / "silent_text.yaml"
    agent.write_text(agent.read_text().replace("std_msgs/msg/Bool", "nav9_msgs/msg/Bool"))
    up = start("up", str(trees), "--no-voice")
    up.until("ready")
    assert up.stop()[0] == 0
    logs = "".join(
        path.read_text() for path in Path(trees).parent.glob("state/bt-agents/logs/*/agents.log")
    )
    assert re.search(r"silent_text\.yaml:\d+:\d+: error\[.*nav9_msgs/msg/Bool", logs)
