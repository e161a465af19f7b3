# SPDX-License-Identifier: Apache-2.0
"""Scene parameters with ``profile: false``: part of every scene, and of no profile."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tools.drawing.outline import outline
from bt_agents_language.tools.schema.generator import file_schema
from file_texts import read_agent_text, read_scene_text

SCENE_TEXT = """\
format: 1
parameters:
  pain: {min: 0, max: 10, default: 0, profile: false, of: person}
  age: {min: 1, max: 5, default: 3}
"""
AGENT_TEXT = """\
format: 1
agent: nurse
profile: {age: 4}
requires: scene.pain < 9
tree:
  sequence:
    - check: scene.pain > 3
    - set: {scene.pain: 2}
    - check: live.pain <= 2
"""
SYMBOLS = SymbolTable(space=read_scene_text(SCENE_TEXT, "scene.yaml").space, skills={})


def read(text: str = AGENT_TEXT) -> AgentSpec:
    return read_agent_text(text, "nurse.yaml", SYMBOLS)


def lines(text: str) -> list[str]:
    with pytest.raises(ReadError) as found:
        read(text)
    return list(found.value.lines)


def test_an_agent_uses_it_and_gives_no_value_for_it():
    assert read().profile == (4.0,)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("profile: {age: 4}", "profile: {age: 4, pain: 3}"),
        ("requires:", "weights: {pain: 2}\nrequires:"),
        ("requires:", "learning: {rates: {pain: 0.2}}\nrequires:"),
        ("requires:", "learning: {freeze: [pain]}\nrequires:"),
        ("requires:", "learning: {retreat: {pain: 2}}\nrequires:"),
        ("set: {scene.pain: 2}", "give_feedback: {kind: direct, values: {pain: 2}}"),
    ],
)
def test_what_is_about_profiles_may_not_name_it(old, new):
    (line, *_) = lines(AGENT_TEXT.replace(old, new))
    assert "error[wrong-value]: no profile has 'pain': scene.yaml says 'profile: false'" in line


def test_its_value_in_a_profile_is_no_name():
    (line, *_) = lines(AGENT_TEXT.replace("live.pain <= 2", "profile.pain <= 2"))
    assert "unknown-name" in line


def test_a_weight_of_what_counts_in_no_distance_is_a_contradiction():
    with pytest.raises(ReadError, match="'profile: false' says that it counts in no distance"):
        read_scene_text(
            SCENE_TEXT.replace("profile: false", "profile: false, weight: 2"), "s.yaml"
        )


def test_one_parameter_at_least_is_part_of_profiles():
    with pytest.raises(ReadError, match="no parameter is part of profiles"):
        read_scene_text(SCENE_TEXT.replace("default: 3}", "default: 3, profile: false}"), "s.yaml")


def test_a_drawn_agent_and_the_schema_of_its_file_show_no_value_for_it():
    assert "pain" not in outline(read(), SYMBOLS.space, 80).splitlines()[1]
    profile = file_schema(AGENT, SYMBOLS.space)["properties"]["profile"]
    assert (list(profile["properties"]), profile["required"]) == (["age"], ["age"])
