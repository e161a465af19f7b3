# SPDX-License-Identifier: Apache-2.0
"""Trace of a run: values that its nodes change and read, and what they count down."""

from __future__ import annotations

import pytest

from bt_agents.engine.countdowns import Countdown, Countdowns
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents.engine.value_trace import ValueTrace, as_written
from bt_agents_core.field_types import FieldType, Plain
from tree_harness import TreeHarness, scene, started


def values(harness: TreeHarness, path: str) -> list[tuple[str, dict[str, str]]]:
    """Return status and changed values of each element of a node so far."""
    return [(one.status.name, dict(one.values)) for one in harness.changes if one.path == path]


def test_element_has_the_changed_values_of_its_node() -> None:
    harness = started(
        "sequence: [{set: {guest: Ann, seats: 2}}, {set: {guest: Ann}}, {set: {guest: Bob}}]"
    )
    assert values(harness, "tree/0.set") == [("SUCCESS", {"guest": "'Ann'", "seats": "2"})]
    assert values(harness, "tree/1.set") == [("SUCCESS", {})]
    assert values(harness, "tree/2.set") == [("SUCCESS", {"guest": "'Bob'"})]
    assert values(harness, "tree") == [("SUCCESS", {})]


def test_node_that_ends_reports_its_changed_values() -> None:
    children = '[{set: {feels: "${live.mood}"}}, {wait: 9 s}]'
    harness = TreeHarness(f"sequence: {{memory: false, children: {children}}}")
    harness.tick(3)
    harness.set_mood(4.5)
    harness.tick(3)
    assert values(harness, "tree/0.set") == [
        ("SUCCESS", {"feels": "3"}),
        ("SUCCESS", {"feels": "4.5"}),
    ]


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
    harness.after(3.0)
    assert values(harness, "tree") == [
        ("RUNNING", {}),
        ("SUCCESS", {"done": "0.5", "words": "'fine'"}),
    ]


def test_a_stopped_node_has_its_values() -> None:
    reply = ScriptedReply(after_s=9.0, feedback=((1.0, {"progress": 0.25}),))
    harness = TreeHarness(FOLLOWED, answers={"dance": [reply]})
    harness.tick(2, step_s=1.0)
    harness.interrupt()
    assert values(harness, "tree")[1:] == [("INVALID", {"done": "0.25"})]


def test_a_subtree_has_its_outputs() -> None:
    subtree = "{inputs: {n: number}, outputs: {twice: number}, tree: {set: {twice: '${n * 2}'}}}"
    harness = started(
        "subtree: double\nwith: {n: 2}\noutputs: {four: twice}",
        head=f"subtrees: {{double: {subtree}}}",
    )
    assert values(harness, "tree") == [("SUCCESS", {"four": "4"})]
    assert values(harness, "tree/double") == [("SUCCESS", {"twice": "4"})]


def test_set_scene_value_is_in_element() -> None:
    harness = started("set: {scene.age: 4}")
    harness.set_live("age", 4.0)
    harness.after(0.1)
    assert values(harness, "tree") == [("RUNNING", {"scene.age": "4"}), ("SUCCESS", {})]


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


def traced(harness: TreeHarness) -> list[tuple[str, str, Plain, bool]]:
    trace = ValueTrace(harness.root)
    harness.tick()
    return [tuple(one) for one in trace.take()]  # type: ignore[misc]


def test_trace_records_reads_and_writes_in_order() -> None:
    harness = TreeHarness(
        "sequence: [{set: {name: Anna}}, {say: 'Hello ${name}'}, {check: scene.age > 2}]"
    )
    assert traced(harness) == [
        ("tree/0.set", "name", "Anna", True),
        ("tree/1.say", "name", "Anna", False),
        ("tree/2.check", "scene.age", 3.0, False),
    ]


def test_trace_records_unchanged_value_once() -> None:
    harness = TreeHarness("wait_for: live.mood > 4")
    trace = ValueTrace(harness.root)
    harness.tick(3)
    assert [one.value for one in trace.take()] == [3.0]
    harness.set_mood(3.5)
    harness.tick(2)
    assert [one.value for one in trace.take()] == [3.5]


def test_missing_value_stays_missing_under_trace() -> None:
    harness = TreeHarness("check: live.age > 1", awarded=scene(mood=3))
    assert traced(harness) == []
    assert (harness.outcome, harness.run.undecided) == ("failed", {})


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "null"),
        (True, "true"),
        (2, "2"),
        (2.50049, "2.5"),
        ("yes\x1b[2J", "'yes [2J'"),
        ((1, "a"), "[1, 'a']"),
        ({"x": 1.0}, "{x: 1}"),
        (tuple(range(25)), "[" + ", ".join(map(str, range(20))) + ", …]"),
    ],
)
def test_value_is_shown_in_author_notation(value: Plain, text: str) -> None:
    assert as_written(value) == text


def test_quantity_is_shown_with_its_unit() -> None:
    assert as_written(90.0, FieldType.DURATION) == "1.5 min"


def running(harness: TreeHarness) -> list[Countdown]:
    return Countdowns(harness.root).running(harness.run.deadlines, harness.environment.clock())


def test_wait_inside_timeout_counts_both_down() -> None:
    harness = started("timeout: 5 s\nwait: 2 s")
    now = harness.environment.clock()
    assert running(harness) == [
        Countdown(path="tree", kind="wait", ends_at=now + 2.0),
        Countdown(path="tree@timeout", kind="timeout", ends_at=now + 5.0),
    ]


def test_retry_counts_remaining_attempts() -> None:
    harness = started("retry: {attempts: 3}\nsequence: [{wait: 1 s}, {check: scene.age > 4}]")
    assert running(harness)[-1] == Countdown(path="tree@retry", kind="retry", remaining=2)
    harness.after(1.0)
    harness.tick()
    assert running(harness)[-1] == Countdown(path="tree@retry", kind="retry", remaining=1)


def test_endless_repeat_has_no_countdown() -> None:
    harness = started("repeat: forever\nwait: 1 s")
    assert [one.kind for one in running(harness)] == ["wait"]


def test_cooldown_counts_down_while_its_child_is_idle() -> None:
    harness = started(
        "sequence: [{say: hello, cooldown: 30 s}, {say: good-bye}]",
        answers={"say": [ScriptedReply(), ScriptedReply(after_s=100.0)]},
    )
    [cooldown] = running(harness)
    assert (cooldown.path, cooldown.kind) == ("tree/0.say@cooldown", "cooldown")
    harness.after(31.0)
    assert running(harness) == []
