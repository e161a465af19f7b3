# SPDX-License-Identifier: Apache-2.0
"""Details of a running tree: values read and written by its nodes, and remaining limits."""

from __future__ import annotations

import pytest

from bt_agents.engine.countdowns import Countdown, Countdowns
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents.engine.value_trace import ValueTrace, as_written
from bt_agents_core.field_types import FieldType, Plain
from tree_harness import TreeHarness, scene, started


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


def test_closed_trace_records_nothing_and_restores_tree() -> None:
    harness = TreeHarness("sequence: [{set: {name: Anna}}, {say: 'Hello ${name}'}]")
    before = [vars(node).get("scope") for node in harness.root.iterate()]
    trace = ValueTrace(harness.root)
    trace.close()
    assert [vars(node).get("scope") for node in harness.root.iterate()] == before
    assert harness.tick() == "succeeded"
    assert (trace.take(), harness.said) == ([], ["Hello Anna"])


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
