# SPDX-License-Identifier: Apache-2.0
"""Warnings about persons that no source of the scene identifies."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bt_agents_language.tools.folder_check import check_folder

SCENE = """\
format: 1
parameters:
  pain: {min: 0, max: 10, default: 0, of: person}
  age: {min: 1, max: 5, default: 3}
remembers: {drink: text}
"""
PERSONS = """\
persons:
  tracked: {topic: faces, type: a/msg/B, field: faces, id: face_id, stale_after: 1 s}
"""
KNOWN = "  known: {from: tracked, field: known}\n"
SOURCE = """\
sources:
  person: {topic: p, type: std_msgs/msg/Bool, field: data, stale_after: 1 s}
"""
AGENT = "format: 1\nagent: nurse\nprofile: {age: 3, pain: 3}\n"


def problems(folder: Path, scene: str, agent: str) -> list[str]:
    (folder / "agents").mkdir()
    (folder / "scene.yaml").write_text(scene)
    (folder / "agents" / "nurse.yaml").write_text(AGENT + agent)
    return [
        f"{Path(one.position.file).name}:{one.position.line} {one.code}: {one.message}"
        for one in check_folder(folder).problems
    ]


@pytest.mark.parametrize(
    ("tree", "what"),
    [
        (
            "tree: {check: person.visits > 1}",
            "4 nobody-known: .*'person.visits' is always missing",
        ),
        ("tree:\n  remember: {drink: tea}", "5 nobody-known: .*'remember' keeps nothing"),
        (
            "requires: person.name == 'a'\ntree: {check: live.age > 2}",
            "1 nobody-known: .*'person.",
        ),
        (
            "tree:\n  sequence:\n    - log: ${person.drink}\n    - log: ${person.name}",
            "6 nobody-known: .*'person.drink' is always missing",
        ),
    ],
)
@pytest.mark.parametrize("persons", ["", PERSONS])
def test_never_known_person_names_are_warned_about_once(tmp_path, tree, what, persons):
    (problem,) = problems(tmp_path, SCENE + (persons or SOURCE), tree)
    assert re.search(f"nurse.yaml:{what}", problem)


@pytest.mark.parametrize(
    ("scene", "name"), [(PERSONS + KNOWN, "person.visits"), (SOURCE, "live.age")]
)
def test_known_or_seen_person_is_not_warned_about(tmp_path, scene, name):
    assert not problems(tmp_path, SCENE + scene, f"tree: {{check: {name} > 1}}")


def test_value_of_unseen_person_is_warned_about(tmp_path):
    (problem,) = problems(tmp_path, SCENE, "tree: {check: live.age > 2}")
    assert problem.startswith("scene.yaml:3 nobody-known: no source sees a person")
