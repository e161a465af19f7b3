# SPDX-License-Identifier: Apache-2.0
"""Scripts of visits, and the specs that they become."""

from __future__ import annotations

import pytest

from agent_texts import problems_of
from bt_agents_language.files.script_reader import read_script
from bt_agents_language.model.specs import SceneChange, Visit
from bt_agents_language.yaml.source import Source
from tree_harness import SPACE


def test_visit_describes_persons_actions():
    text = """\
format: 1
title: A day
visits:
  - label: a person
    scene: {mood: 3, age: 4}
    answers: {where to: Gate 12, shall we: yes}
    buttons: {buttons/confirm: green button}
    changes:
      - {after: 3 s, person: false}
      - {after: 500 ms, scene: {mood: 1.5}}
  - {label: a ladder, person: false}
  - {label: an alarm, person: false, urgent: true}
  - {label: somebody known, name: anna}
"""
    script = read_script(Source("s.yaml", text), SPACE)
    assert script.title == "A day"
    assert script.visits == (
        Visit(
            label="a person",
            person=True,
            values={"mood": 3.0, "age": 4.0},
            changes=(
                SceneChange(after_s=0.5, values={"mood": 1.5}),
                SceneChange(after_s=3.0, values={}, person=False),
            ),
            answers={"where to": "Gate 12", "shall we": "yes"},
            buttons={"buttons/confirm": "green button"},
        ),
        Visit(label="a ladder", person=False, values={}),
        Visit(label="an alarm", person=False, values={}, urgent=True),
        Visit(label="somebody known", person=True, values={}, name="anna"),
    )


@pytest.mark.parametrize(
    ("visit", "problem"),
    [
        ("{label: a, name: anna, person: false}", "misplaced-key"),
        (f"{{label: a, name: {'x' * 101}}}", "bad-name"),
        ('{label: a, name: "an\\nna"}', "bad-name"),
    ],
)
def test_script_name_must_belong_to_present_person(visit: str, problem: str):
    source = Source("s.yaml", f"format: 1\ntitle: t\nvisits:\n  - {visit}\n")
    assert [one.code for one in problems_of(read_script, source, SPACE)] == [problem]
