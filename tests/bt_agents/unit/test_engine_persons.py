# SPDX-License-Identifier: Apache-2.0
"""A person in a tree: their name and visits, what is remembered of them, what they have told."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents_core.scene import Scene
from tree_harness import Stage, scene

ANNA = replace(scene(age=3), person_id="anna", visits=2)
NAMES = {"remember": "scene_layer/remember", "analyze": "scene_layer/analyze"}


def stage(tree: str, awarded: Scene = ANNA, **answers: ScriptedReply) -> Stage:
    replies = {NAMES.get(key, key): [one] for key, one in answers.items()}
    return Stage(tree, awarded=awarded, answers=replies)


def said(one: Stage) -> list[Any]:
    return [
        goal.goal.fields["text"] for goal in one.environment.goals if "text" in goal.goal.fields
    ]


def reason(one: Stage) -> str:
    assert one.run.result is not None
    return one.run.result.message


def test_a_person_who_is_known_has_a_name_and_visits() -> None:
    one = stage("say: ${person.name} ${person.visits}")
    assert one.tick() == "succeeded"
    assert said(one) == ["anna 2"]


def test_a_person_who_is_not_known_has_neither() -> None:
    one = stage("say: Hello ${person.name else 'you'}!", replace(ANNA, visits=0))
    assert one.tick() == "succeeded"
    assert said(one) == ["Hello you!"]


def test_whoever_comes_later_is_the_person_of_a_run_that_began_with_nobody() -> None:
    one = stage("wait_for: {condition: person.name == 'anna'}", scene(person=False))
    assert one.tick() == "running"
    one.live = ANNA
    assert one.after(0.1) == "succeeded"


def test_what_is_remembered_has_its_name_at_once_also_inside_of_a_subtree() -> None:
    one = Stage(
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
def test_what_the_scene_layer_does_not_take_is_not_remembered(
    reply: ScriptedReply, words: str
) -> None:
    tree = "remember: {favourite: tea}\non_failure: {check: known(person.favourite)}"
    one = stage(tree, remember=reply)
    assert one.tick(30, 0.1) == "failed"
    assert any(change.message.startswith(words) for change in one.changes)


def test_nothing_is_remembered_of_somebody_who_is_not_known() -> None:
    one = stage("remember: {favourite: tea}", replace(ANNA, visits=0))
    assert one.tick() == "failed"
    assert reason(one).startswith("nobody who is known by name is there")
    assert not one.environment.goals


def test_a_text_without_an_end_is_not_sent() -> None:
    one = stage(f"remember: {{favourite: {'x' * 501}}}")
    assert one.tick() == "failed"
    assert reason(one).startswith("favourite has 501 characters, expected 500 at most")
    assert not one.environment.goals


def test_a_told_value_goes_to_the_scene_layer_and_is_waited_for_in_the_live_scene() -> None:
    one = stage("sequence: [{set: {scene.age: 4, n: 1}}, {say: '${scene.age} ${live.age} ${n}'}]")
    assert one.tick() == "running"
    assert [goal.goal.fields for goal in one.environment.goals] == [
        {"names": ("age",), "values": (4.0,), "told": True}
    ]
    one.set_live("age", 4.0)
    assert one.tick() == "succeeded"
    assert said(one) == ["4 4 1"]


def test_a_newer_value_in_the_live_scene_does_not_hold_the_tree_up() -> None:
    one = stage("sequence: [{set: {scene.age: 4}}, {say: '${scene.age} ${live.age}'}]")
    one.tick()
    one.set_live("age", 2.0)
    assert one.after(0.4) == "running"
    assert one.after(0.2) == "succeeded"
    assert said(one) == ["4 2"]


def test_the_change_of_the_mood_counts_from_the_scene_as_awarded() -> None:
    one = stage("sequence: [{set: {scene.mood: 1}}, {check: mood.change == -2}]", scene(mood=3))
    one.set_mood(1.0)
    assert one.tick() == "succeeded"


@pytest.mark.parametrize(
    ("value", "words"),
    [("${1 + 8}", "set: age is 9, expected 1 to 5"), ("${number('few')}", "in the text 'few'")],
)
def test_a_value_out_of_range_is_not_told(value: str, words: str) -> None:
    one = stage(f'set: {{scene.age: "{value}"}}')
    assert one.tick() == "failed"
    assert words in reason(one)
    assert not one.environment.goals


def test_a_scene_layer_that_refuses_a_told_value_fails_the_node() -> None:
    refused = ScriptedReply(result={"accepted": False, "code": "NOT_RUNNING", "message": ""})
    one = stage("set: {scene.age: 4}", analyze=refused)
    assert one.tick() == "failed"
    assert reason(one).startswith("the scene layer refuses it: NOT_RUNNING")
