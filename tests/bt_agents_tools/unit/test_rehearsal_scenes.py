# SPDX-License-Identifier: Apache-2.0
"""Scenes in rehearsals: moods and their rules, persons, a silent scene layer."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pytest
from click.testing import CliRunner

from bt_agents.engine.run import TreeOutcome
from bt_agents_tools.cli.main import bt_agents
from bt_agents_tools.rehearsal.events import EventKind, Rehearsed
from rehearsal_harness import documented_tree, events_of, rehearsed, spoken_texts


def test_undecidable_rule_is_reported():
    head = "feedback: [{give: positive, when: 1 / (live.mood - 4) > 0}]\n"
    result = rehearsed("wait: 9 s", "during: [{after: 2 s, mood: 4}]\n", head=head)
    assert events_of(result, EventKind.LOGS) == [
        (2.0, "error: the mood rule cannot be decided: 1 / (live.mood - 4) > 0 ('/' by zero)")
    ]


def test_baseline_completes_without_events():
    rule = "when: live.mood == 3 and mood.change == 0, baseline: 10 s"
    result = rehearsed("wait: 60 s", head=f"feedback: [{{give: positive, {rule}}}]\n")
    [(at_s, _)] = events_of(result, EventKind.FEEDBACK)
    assert at_s == pytest.approx(10.0, abs=0.3)


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
    assert "nobody who is known by name is there" in rehearsed(FAVOURITE).message


TELLING = """
sequence:
  - ask: {text: How do you feel?, choices: ["1", "2"]}
  - set: {scene.mood: "${number(answer)}"}
  - say: ${scene.mood} ${live.mood} ${mood.change}
"""


def test_told_value_enters_scene_and_moves_mood() -> None:
    result = rehearsed(TELLING, head="feedback: [{when: mood.change <= -1, give: negative}]")
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


SILENT = "after: 500 ms, scene_layer: silent"
TREE = documented_tree("expressions.md", "live.stale")


def story(tree: str, *happenings: str, head: str = "", more: str = "") -> Rehearsed:
    """Return the course of a tree under some events."""
    items = "".join(f"  - {{{one}}}\n" for one in happenings)
    return rehearsed(tree, more + (f"during:\n{items}" if items else ""), head=head)


def test_silent_scene_layer_makes_scene_stale_after_lease() -> None:
    result = story("wait_for: live.stale", "after: 2 s, scene_layer: silent")
    assert result.outcome is TreeOutcome.SUCCEEDED
    assert result.duration_s == pytest.approx(3.0, abs=0.01)
    assert events_of(result, EventKind.SCENE) == [(2.0, "the scene layer is silent")]


def test_changes_during_silence_appear_when_scene_layer_returns() -> None:
    result = story(
        "wait_for: live.mood == 5",
        "after: 2 s, scene_layer: silent",
        "after: 2500 ms, mood: 5",
        "after: 9 s, scene_layer: back",
    )
    assert result.duration_s == pytest.approx(9.0)


def test_mood_rule_pauses_and_resets_during_silence() -> None:
    rule = "feedback: [{when: mood.change <= -1, for: 2 s, give: negative, then: cancel}]"
    worse, silent = "after: 1 s, mood: 1", "after: 1500 ms, scene_layer: silent"
    result = story("wait: 30 s", worse, silent, "after: 10 s, scene_layer: back", head=rule)
    assert result.cancelled_by == "mood.change <= -1"
    assert result.duration_s == pytest.approx(12.0, abs=0.01)
    assert not story("wait: 30 s", worse, silent, head=rule).cancelled_by


@pytest.mark.parametrize(
    ("happenings", "texts"),
    [
        ((), ["Let me show you everything."]),
        (("after: 0 s, mood: 1",), ["I will be quick."]),
        ((SILENT,), ["Let me show you everything.", "I wait here until I see you again."]),
        ((SILENT, "after: 4 s, scene_layer: back"), ["Let me show you everything."]),
    ],
)
def test_documented_tree_handles_stale_scene(
    happenings: tuple[str, ...], texts: list[str]
) -> None:
    result = story(TREE, *happenings, more="answers: {drive: {after: 20 s}}\n")
    assert (spoken_texts(result), result.outcome) == (texts, TreeOutcome.SUCCEEDED)


def test_documented_tree_skips_already_stale_mood() -> None:
    rest = textwrap.indent(TREE, "    ").strip()
    result = story(f"sequence:\n  - wait: 3 s\n  - {rest}", "after: 0 s, scene_layer: silent")
    assert spoken_texts(result)[0] == "Follow me."
