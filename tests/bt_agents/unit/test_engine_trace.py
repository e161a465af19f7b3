# SPDX-License-Identifier: Apache-2.0
"""The trace of a run: each element has the values that its node has changed."""

from __future__ import annotations

import pytest

from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents.engine.value_trace import as_written
from tree_harness import Stage, scene

REACTIVE = """
sequence:
  memory: false
  children:
    - set: {feels: "${live.mood}"}
    - wait: 9 s
"""


def values(stage: Stage, path: str) -> list[tuple[str, dict[str, str]]]:
    """Return status and changed values of each element of a node so far."""
    return [(one.status.name, dict(one.values)) for one in stage.changes if one.path == path]


def test_an_element_has_the_values_of_its_node() -> None:
    stage = Stage("sequence: [{set: {guest: Ann, seats: 2}}, {say: hello}]")
    stage.tick()
    assert values(stage, "tree/0.set") == [("SUCCESS", {"guest": "'Ann'", "seats": "2"})]
    assert values(stage, "tree/1.say") == [("SUCCESS", {})]
    assert values(stage, "tree") == [("SUCCESS", {})]


def test_node_that_ends_reports_its_changed_values() -> None:
    stage = Stage(REACTIVE)
    stage.tick(3)
    stage.set_mood(4.5)
    stage.tick(3)
    assert values(stage, "tree/0.set") == [
        ("SUCCESS", {"feels": "3"}),
        ("SUCCESS", {"feels": "4.5"}),
    ]


def test_a_value_that_stays_is_no_change() -> None:
    stage = Stage("sequence: [{set: {word: a}}, {set: {word: a}}, {set: {word: b}}]")
    stage.tick()
    assert values(stage, "tree/1.set") == [("SUCCESS", {})]
    assert values(stage, "tree/2.set") == [("SUCCESS", {"word": "'b'"})]


FOLLOWED = """
action:
  name: dance
  type: bt_agents_interfaces/action/Say
  goal: {text: x}
  outputs: {done: feedback.progress, words: message}
"""


def test_feedback_comes_with_the_next_element() -> None:
    told = ((1.0, {"progress": 0.25}), (2.0, {"progress": 0.5}))
    reply = ScriptedReply(after_s=5.0, feedback=told, result={"message": "fine"})
    stage = Stage(FOLLOWED, answers={"dance": [reply]})
    stage.tick(3, step_s=1.0)
    assert values(stage, "tree") == [("RUNNING", {})]
    stage.after(3.0)
    assert values(stage, "tree")[1:] == [("SUCCESS", {"done": "0.5", "words": "'fine'"})]


def test_a_stopped_node_has_its_values() -> None:
    reply = ScriptedReply(after_s=9.0, feedback=((1.0, {"progress": 0.25}),))
    stage = Stage(FOLLOWED, answers={"dance": [reply]})
    stage.tick(2, step_s=1.0)
    stage.interrupt()
    assert values(stage, "tree")[1:] == [("INVALID", {"done": "0.25"})]


def test_a_subtree_has_its_outputs() -> None:
    head = """
subtrees:
  double:
    inputs: {n: number}
    outputs: {twice: number}
    tree: {set: {twice: "${n * 2}"}}
"""
    stage = Stage("subtree: double\nwith: {n: 2}\noutputs: {four: twice}", head=head)
    stage.tick()
    assert values(stage, "tree") == [("SUCCESS", {"four": "4"})]
    assert values(stage, "tree/double") == [("SUCCESS", {"twice": "4"})]


def test_set_scene_value_is_in_element() -> None:
    stage = Stage("set: {scene.age: 4}", awarded=scene(age=3, familiarity=3, mood=3))
    stage.tick()
    assert values(stage, "tree") == [("RUNNING", {"scene.age": "4"})]
    stage.set_live("age", 4.0)
    stage.after(0.1)
    assert values(stage, "tree")[1:] == [("SUCCESS", {})]


def test_a_tick_reports_a_limited_number_of_values() -> None:
    names = ", ".join(f"n{number}: {number}" for number in range(600))
    stage = Stage(f"sequence: [{{set: {{{names}}}}}, {{set: {{last: 1}}}}, {{wait: 1 s}}]")
    stage.tick()
    [(_, found)] = values(stage, "tree/0.set")
    assert list(found.items())[-1] == ("n499", "499")
    assert values(stage, "tree/1.set") == [("SUCCESS", {})]


@pytest.mark.parametrize(
    "value",
    [10**5000, [[0] * 1000] * 1000, {"k" * 9999: {"v" * 9999: 1}}],
    ids=["number", "list", "mapping"],
)
def test_long_values_are_shortened(value: object) -> None:
    assert len(as_written(value)) <= 200  # type: ignore[arg-type]
