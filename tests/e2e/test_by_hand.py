# SPDX-License-Identifier: Apache-2.0
"""The command line in the role of the person in front of the robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from programs import Ask, Start

pytestmark = pytest.mark.e2e


AGENT = """
format: 1
agent: asker
title: Asker
description: Asks and waits for a button.
profile: {age: 3, familiarity: 3, mood: 3}
requires: scene.person
tree:
  sequence:
    - ask: {text: "Shall we?", choices: ["Yes", "No"], wait: 5 min}
    - parallel:
        - wait_for: {topic: buttons/confirm, type: std_msgs/msg/Bool, until: msg.data}
        - say: Press the button.
"""
SCRIPT = """
format: 1
visits:
  - label: a guest
    scene: {age: 3, familiarity: 3, mood: 3}
    answers: {shall we: "no"}
    buttons: {buttons/confirm: press the}
  - {label: a ladder, person: false}
"""


def test_person_answers_presses_button_and_visits(
    start: Start, start_up: Start, ask: Ask, trees: Path, tmp_path: Path
) -> None:
    for path in (trees / "agents").iterdir():
        path.unlink()
    (trees / "agents" / "asker.yaml").write_text(AGENT)
    up = start_up(str(trees))
    assert "the robot asks nothing now" in ask("answer")
    assert "NO_QUESTION" in ask("answer", "yes", code=1)
    assert "NOBODY_LISTENS" in ask("press", "buttons/confirm", code=1)
    ask("trigger", "age=3")
    up.until("asks: Shall we")
    assert "the robot is asking: Shall we? (answers: Yes, No)" in ask("answer")
    assert "NOT_A_CHOICE" in ask("answer", "per", "haps", code=1)
    assert "answered 'Yes' to: Shall we?" in ask("answer", "yes")
    up.until("says: Press")
    assert "buttons/confirm  (std_msgs/msg/Bool)" in ask("press")
    assert "did you mean 'buttons/confirm'" in ask("press", "buttons/confrim", code=1)
    assert "live scene updated" in ask("sense", "--no-person")
    assert "pressed buttons/confirm" in ask("press", "buttons/confirm")
    up.until("asker succeeded")
    assert "person/age" in ask("publish")

    script = tmp_path / "script.yaml"
    script.write_text(SCRIPT)
    visit = start("visit", str(script))
    up.until("a guest")
    assert visit.wait() == 0, visit.output
    assert "a guest\n" in visit.output
    assert "all visits are over" in visit.output
    # The system continues: it was not started for these visitors.
    missing = ask("visit", str(tmp_path / "none.yaml"), code=1)
    assert "there is no such file" in " ".join(missing.split())
