# SPDX-License-Identifier: Apache-2.0
"""Rehearsals with a silent scene layer."""

from __future__ import annotations

import textwrap

import pytest

from bt_agents.engine.run import TreeOutcome
from bt_agents_tools.rehearsal.events import EventKind, Rehearsed
from rehearsal_harness import documented_tree, events_of, rehearsed, spoken_texts

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
        (
            ("after: 500 ms, scene_layer: silent",),
            ["Let me show you everything.", "I wait here until I see you again."],
        ),
        (
            ("after: 500 ms, scene_layer: silent", "after: 4 s, scene_layer: back"),
            ["Let me show you everything."],
        ),
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
