# SPDX-License-Identifier: Apache-2.0
"""Persons in rehearsals: identity, remembered facts, told values."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from bt_agents_tools.cli.main import bt_agents
from bt_agents_tools.rehearsal.events import EventKind
from rehearsal_harness import events_of, rehearsed, spoken_texts

FAVOURITE = """
sequence:
  - when: not known(person.favourite)
    sequence:
      - ask: What do you like to drink?
      - remember: {favourite: "${answer}"}
  - say: ${person.name}, ${person.favourite}? Visit ${person.visits}.
"""


def test_an_agent_asks_once_and_remembers_the_answer() -> None:
    result = rehearsed(FAVOURITE, "person: {name: anna}\nanswers: {ask: tea}")
    assert spoken_texts(result)[-1] == "anna, tea? Visit 1."
    assert events_of(result, EventKind.SCENE) == [
        (pytest.approx(4.0, abs=2.0), "remembered: favourite tea")
    ]
    again = "person: {name: anna, visits: 2, remembers: {favourite: tea}}"
    assert spoken_texts(rehearsed(FAVOURITE, again)) == ["anna, tea? Visit 2."]


def test_stranger_is_not_remembered() -> None:
    result = rehearsed(FAVOURITE)
    assert "nobody who is known by name is there" in result.message


TELLING = """
sequence:
  - ask: {text: How do you feel?, choices: ["1", "2"]}
  - set: {scene.mood: "${number(answer)}"}
  - say: ${scene.mood} ${live.mood} ${mood.change}
"""


def test_told_value_enters_scene_and_moves_mood() -> None:
    rules = "feedback: [{when: mood.change <= -1, give: negative}]"
    result = rehearsed(TELLING, head=rules)
    assert spoken_texts(result)[-1] == "1 1 -2"
    assert [text for _, text in events_of(result, EventKind.SCENE)] == ["told: mood 1"]
    assert [one.name for one in result.feedback] == ["NEGATIVE"]


def test_silent_scene_layer_accepts_no_values() -> None:
    result = rehearsed(TELLING, "during: [{after: 1 s, scene_layer: silent}]")
    assert "the scene layer is unreachable" in result.message


def test_person_is_a_command_option(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parents[3])
    options = ["--person", "name=anna", "--person", "visits=2", "--person", "favourite=green tea"]
    shown = CliRunner().invoke(bt_agents, ["rehearse", "silent_text", *options])
    assert "anna's visit 2, favourite green tea" in shown.output
    wrong = CliRunner().invoke(bt_agents, ["rehearse", "silent_text", "--person", "favorit=tea"])
    assert "did you mean 'favourite'?" in str(wrong.exception)
