# SPDX-License-Identifier: Apache-2.0
"""Trace of a run: each element has the values that its node changed."""

from __future__ import annotations

import pytest

from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents.engine.value_trace import as_written
from tree_harness import TreeHarness, scene, started

REACTIVE = """
sequence:
  memory: false
  children:
    - set: {feels: "${live.mood}"}
    - wait: 9 s
"""


def values(harness: TreeHarness, path: str) -> list[tuple[str, dict[str, str]]]:
    """Return status and changed values of each element of a node so far."""
    return [(one.status.name, dict(one.values)) for one in harness.changes if one.path == path]


def test_an_element_has_the_values_of_its_node() -> None:
    harness = started("sequence: [{set: {guest: Ann, seats: 2}}, {say: hello}]")
    assert values(harness, "tree/0.set") == [("SUCCESS", {"guest": "'Ann'", "seats": "2"})]
    assert values(harness, "tree/1.say") == [("SUCCESS", {})]
    assert values(harness, "tree") == [("SUCCESS", {})]


def test_node_that_ends_reports_its_changed_values() -> None:
    harness = TreeHarness(REACTIVE)
    harness.tick(3)
    harness.set_mood(4.5)
    harness.tick(3)
    assert values(harness, "tree/0.set") == [
        ("SUCCESS", {"feels": "3"}),
        ("SUCCESS", {"feels": "4.5"}),
    ]


def test_a_value_that_stays_is_no_change() -> None:
    harness = started("sequence: [{set: {word: a}}, {set: {word: a}}, {set: {word: b}}]")
    assert values(harness, "tree/1.set") == [("SUCCESS", {})]
    assert values(harness, "tree/2.set") == [("SUCCESS", {"word": "'b'"})]


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
    harness = TreeHarness(FOLLOWED, answers={"dance": [reply]})
    harness.tick(3, step_s=1.0)
    assert values(harness, "tree") == [("RUNNING", {})]
    harness.after(3.0)
    assert values(harness, "tree")[1:] == [("SUCCESS", {"done": "0.5", "words": "'fine'"})]


def test_a_stopped_node_has_its_values() -> None:
    reply = ScriptedReply(after_s=9.0, feedback=((1.0, {"progress": 0.25}),))
    harness = TreeHarness(FOLLOWED, answers={"dance": [reply]})
    harness.tick(2, step_s=1.0)
    harness.interrupt()
    assert values(harness, "tree")[1:] == [("INVALID", {"done": "0.25"})]


def test_a_subtree_has_its_outputs() -> None:
    head = """
subtrees:
  double:
    inputs: {n: number}
    outputs: {twice: number}
    tree: {set: {twice: "${n * 2}"}}
"""
    harness = started("subtree: double\nwith: {n: 2}\noutputs: {four: twice}", head=head)
    assert values(harness, "tree") == [("SUCCESS", {"four": "4"})]
    assert values(harness, "tree/double") == [("SUCCESS", {"twice": "4"})]


def test_set_scene_value_is_in_element() -> None:
    harness = started("set: {scene.age: 4}", awarded=scene(age=3, familiarity=3, mood=3))
    assert values(harness, "tree") == [("RUNNING", {"scene.age": "4"})]
    harness.set_live("age", 4.0)
    harness.after(0.1)
    assert values(harness, "tree")[1:] == [("SUCCESS", {})]


def test_a_tick_reports_a_limited_number_of_values() -> None:
    names = ", ".join(f"n{number}: {number}" for number in range(600))
    harness = started(f"sequence: [{{set: {{{names}}}}}, {{set: {{last: 1}}}}, {{wait: 1 s}}]")
    [(_, found)] = values(harness, "tree/0.set")
    assert list(found.items())[-1] == ("n499", "499")
    assert values(harness, "tree/1.set") == [("SUCCESS", {})]


@pytest.mark.parametrize(
    "value",
    [10**5000, "x" * 9999, [[0] * 1000] * 1000, {"k" * 9999: {"v" * 9999: 1}}],
    ids=["number", "text", "list", "mapping"],
)
def test_long_values_are_shortened(value: object) -> None:
    assert len(as_written(value)) <= 200  # type: ignore[arg-type]
