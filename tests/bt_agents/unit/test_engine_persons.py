# SPDX-License-Identifier: Apache-2.0
"""Persons in trees: name and visits, remembered facts, told values."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import TreeHarness, failure, scene, started

ANNA = replace(scene(age=3), person_id="anna", visits=2)


@pytest.mark.parametrize(("visits", "text"), [(2, "anna 2"), (0, "nobody 0")])
def test_only_known_person_has_name_and_visits(visits: int, text: str) -> None:
    tree = "say: ${person.name else 'nobody'} ${person.visits else 0}"
    assert started(tree, awarded=replace(ANNA, visits=visits)).said == [text]


def test_later_arrival_becomes_person_of_empty_run() -> None:
    tree = "wait_for: {condition: person.name == 'anna'}"
    one = started(tree, awarded=scene(person=False))
    one.live = ANNA
    assert one.outcomes(0.1) == "S"


def test_remembered_fact_is_readable_immediately_in_subtree() -> None:
    one = started(
        "sequence: [{remember: {favourite: tea}}, {subtree: offer}]",
        head="subtrees: {offer: {tree: {say: '${person.favourite}?'}}}",
        awarded=ANNA,
    )
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
    one = TreeHarness(tree, awarded=ANNA, answers={"scene_layer/remember": [reply]})
    assert one.tick(30, 0.1) == "failed"
    assert any(change.message.startswith(words) for change in one.changes)


@pytest.mark.parametrize(
    ("tree", "visits", "words"),
    [
        ("remember: {favourite: tea}", 0, "nobody who is known by name is there"),
        (
            f"remember: {{favourite: {'x' * 501}}}",
            2,
            "favourite has 501 characters, expected 500 at most",
        ),
        ('set: {scene.age: "${1 + 8}"}', 2, "set: age is 9, expected 1 to 5"),
        ("set: {scene.age: \"${number('few')}\"}", 2, "found none in digits in the text 'few'"),
    ],
)
def test_impossible_fact_or_value_is_not_sent(tree: str, visits: int, words: str) -> None:
    one = started(tree, awarded=replace(ANNA, visits=visits))
    assert one.outcome == "failed"
    assert words in one.message
    assert not one.environment.goals


def test_told_value_is_sent_and_awaited_in_scene() -> None:
    tree = "sequence: [{set: {scene.age: 4, n: 1}}, {say: '${scene.age} ${live.age} ${n}'}]"
    one = started(tree, awarded=ANNA)
    assert one.outcome == "running"
    assert [goal.goal.fields for goal in one.environment.goals] == [
        {"names": ("age",), "values": (4.0,), "told": True}
    ]
    one.set_live("age", 4.0)
    assert (one.tick(), one.said) == ("succeeded", ["4 4 1"])


def test_newer_live_value_does_not_block_set() -> None:
    tree = "sequence: [{set: {scene.age: 4}}, {say: '${scene.age} ${live.age}'}]"
    one = started(tree, awarded=ANNA)
    one.set_live("age", 2.0)
    assert (one.outcomes(0.4, 0.2), one.said) == ("RS", ["4 2"])


def test_mood_change_is_relative_to_awarded_scene() -> None:
    tree = "sequence: [{set: {scene.mood: 1}}, {check: mood.change == -2}]"
    one = TreeHarness(tree, awarded=scene(mood=3))
    one.set_mood(1.0)
    assert one.tick() == "succeeded"


def test_set_fails_when_scene_layer_refuses_value() -> None:
    refused = ScriptedReply(result={"accepted": False, "code": "NOT_RUNNING", "message": ""})
    answers = {"scene_layer/analyze": [refused]}
    message = failure("set: {scene.age: 4}", awarded=ANNA, answers=answers)
    assert message.startswith("the scene layer refuses it: NOT_RUNNING")
