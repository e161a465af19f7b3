# SPDX-License-Identifier: Apache-2.0
"""Persons in trees: name and visits, remembered facts, told values."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents_core.scene import Scene
from tree_harness import TreeHarness, scene

ANNA = replace(scene(age=3), person_id="anna", visits=2)
NAMES = {"remember": "scene_layer/remember", "analyze": "scene_layer/analyze"}


def harness(tree: str, awarded: Scene = ANNA, **answers: ScriptedReply) -> TreeHarness:
    replies = {NAMES.get(key, key): [one] for key, one in answers.items()}
    return TreeHarness(tree, awarded=awarded, answers=replies)


@pytest.mark.parametrize(("visits", "text"), [(2, "anna 2"), (0, "nobody 0")])
def test_only_known_person_has_name_and_visits(visits: int, text: str) -> None:
    tree = "say: ${person.name else 'nobody'} ${person.visits else 0}"
    one = harness(tree, replace(ANNA, visits=visits))
    assert one.tick() == "succeeded"
    assert one.said == [text]


def test_later_arrival_becomes_person_of_empty_run() -> None:
    one = harness("wait_for: {condition: person.name == 'anna'}", scene(person=False))
    assert one.tick() == "running"
    one.live = ANNA
    assert one.after(0.1) == "succeeded"


def test_remembered_fact_is_readable_immediately_in_subtree() -> None:
    one = TreeHarness(
        """
        sequence:
          - remember: {favourite: tea}
          - subtree: offer
        """,
        head="subtrees: {offer: {tree: {say: '${person.favourite}?'}}}",
        awarded=ANNA,
    )
    assert one.tick() == "succeeded"
    [request, spoken] = [goal.goal for goal in one.environment.goals]
    assert request.fields == {
        "person_id": "anna",
        "facts": ({"key": "favourite", "value": {"type": 4, "string_value": "tea"}},),
    }
    assert spoken.fields["text"] == "tea?"


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (
            ScriptedReply(result={"accepted": False, "message": "anna is forgotten"}),
            "the scene layer refuses it: anna is forgotten",
        ),
        (
            ScriptedReply(state=GoalState.UNREACHABLE, message="its server is not there"),
            "the scene layer is unreachable: its server is not there",
        ),
        (ScriptedReply(after_s=9.0), "the scene layer is timed out: no answer within 1 s"),
    ],
)
def test_fact_refused_by_scene_layer_is_not_remembered(reply: ScriptedReply, words: str) -> None:
    tree = "remember: {favourite: tea}\non_failure: {check: known(person.favourite)}"
    one = harness(tree, remember=reply)
    assert one.tick(30, 0.1) == "failed"
    assert any(change.message.startswith(words) for change in one.changes)


def test_remember_fails_for_unknown_person() -> None:
    one = harness("remember: {favourite: tea}", replace(ANNA, visits=0))
    assert one.tick() == "failed"
    assert one.message.startswith("nobody who is known by name is there")
    assert not one.environment.goals


def test_overlong_fact_is_not_sent() -> None:
    one = harness(f"remember: {{favourite: {'x' * 501}}}")
    assert one.tick() == "failed"
    assert one.message.startswith("favourite has 501 characters, expected 500 at most")
    assert not one.environment.goals


def test_told_value_is_sent_and_awaited_in_scene() -> None:
    one = harness(
        "sequence: [{set: {scene.age: 4, n: 1}}, {say: '${scene.age} ${live.age} ${n}'}]"
    )
    assert one.tick() == "running"
    assert [goal.goal.fields for goal in one.environment.goals] == [
        {"names": ("age",), "values": (4.0,), "told": True}
    ]
    one.set_live("age", 4.0)
    assert one.tick() == "succeeded"
    assert one.said == ["4 4 1"]


def test_newer_live_value_does_not_block_set() -> None:
    one = harness("sequence: [{set: {scene.age: 4}}, {say: '${scene.age} ${live.age}'}]")
    one.tick()
    one.set_live("age", 2.0)
    assert one.after(0.4) == "running"
    assert one.after(0.2) == "succeeded"
    assert one.said == ["4 2"]


def test_mood_change_is_relative_to_awarded_scene() -> None:
    one = harness("sequence: [{set: {scene.mood: 1}}, {check: mood.change == -2}]", scene(mood=3))
    one.set_mood(1.0)
    assert one.tick() == "succeeded"


@pytest.mark.parametrize(
    ("value", "words"),
    [("${1 + 8}", "set: age is 9, expected 1 to 5"), ("${number('few')}", "in the text 'few'")],
)
def test_out_of_range_value_is_not_sent(value: str, words: str) -> None:
    one = harness(f'set: {{scene.age: "{value}"}}')
    assert one.tick() == "failed"
    assert words in one.message
    assert not one.environment.goals


def test_set_fails_when_scene_layer_refuses_value() -> None:
    refused = ScriptedReply(result={"accepted": False, "code": "NOT_RUNNING", "message": ""})
    one = harness("set: {scene.age: 4}", analyze=refused)
    assert one.tick() == "failed"
    assert one.message.startswith("the scene layer refuses it: NOT_RUNNING")
