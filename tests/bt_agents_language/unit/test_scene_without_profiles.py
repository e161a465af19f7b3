# SPDX-License-Identifier: Apache-2.0
"""Scene parameters with ``profile: false``: in every scene, but in no profile."""

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


def test_agent_uses_parameter_without_profile_value():
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
def test_profile_keys_may_not_name_the_parameter(old, new):
    (line, *_) = lines(AGENT_TEXT.replace(old, new))
    assert "error[wrong-value]: no profile has 'pain': scene.yaml says 'profile: false'" in line


def test_profile_value_of_parameter_is_unknown_name():
    (line, *_) = lines(AGENT_TEXT.replace("live.pain <= 2", "profile.pain <= 2"))
    assert "unknown-name" in line


def test_weight_of_parameter_without_profile_is_rejected():
    with pytest.raises(ReadError, match="'profile: false' says that it counts in no distance"):
        read_scene_text(
            SCENE_TEXT.replace("profile: false", "profile: false, weight: 2"), "s.yaml"
        )


def test_profiles_need_at_least_one_parameter():
    with pytest.raises(ReadError, match="no parameter is part of profiles"):
        read_scene_text(SCENE_TEXT.replace("default: 3}", "default: 3, profile: false}"), "s.yaml")


def test_drawing_and_schema_show_no_profile_value():
    assert "pain" not in outline(read(), SYMBOLS.space, 80).splitlines()[1]
    profile = file_schema(AGENT, SYMBOLS.space)["properties"]["profile"]
    assert (list(profile["properties"]), profile["required"]) == (["age"], ["age"])
