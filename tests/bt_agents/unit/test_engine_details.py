# SPDX-License-Identifier: Apache-2.0
"""Details of a running tree: values that its nodes read and write, and what is left of limits."""

from __future__ import annotations

import pytest

from bt_agents.engine.countdowns import Countdown, Countdowns
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents.engine.value_trace import ValueTrace, as_written
from bt_agents_core.field_types import FieldType, Plain
from tree_harness import Stage, scene


def traced(stage: Stage) -> list[tuple[str, str, Plain, bool]]:
    trace = ValueTrace(stage.root)
    stage.tick()
    return [tuple(one) for one in trace.take()]  # type: ignore[misc]


def test_trace_records_reads_and_writes_in_order() -> None:
    stage = Stage(
        "sequence: [{set: {name: Anna}}, {say: 'Hello ${name}'}, {check: scene.age > 2}]"
    )
    assert traced(stage) == [
        ("tree/0.set", "name", "Anna", True),
        ("tree/1.say", "name", "Anna", False),
        ("tree/2.check", "scene.age", 3.0, False),
    ]


def test_trace_records_unchanged_value_once() -> None:
    stage = Stage("wait_for: live.mood > 4")
    trace = ValueTrace(stage.root)
    stage.tick(3)
    assert [one.value for one in trace.take()] == [3.0]
    stage.set_mood(3.5)
    stage.tick(2)
    assert [one.value for one in trace.take()] == [3.5]


def test_closed_trace_records_nothing_and_restores_tree() -> None:
    stage = Stage("sequence: [{set: {name: Anna}}, {say: 'Hello ${name}'}]")
    before = [vars(node).get("scope") for node in stage.root.iterate()]
    trace = ValueTrace(stage.root)
    trace.close()
    assert [vars(node).get("scope") for node in stage.root.iterate()] == before
    assert stage.tick() == "succeeded"
    assert (trace.take(), stage.said) == ([], ["Hello Anna"])


def test_missing_value_stays_missing_under_trace() -> None:
    stage = Stage("check: live.age > 1", awarded=scene(mood=3))
    assert traced(stage) == []
    assert (stage.outcome, stage.run.undecided) == ("failed", {})


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


def test_long_value_is_truncated() -> None:
    assert len(as_written("x" * 10_000)) == 200


def running(stage: Stage) -> list[Countdown]:
    return Countdowns(stage.root).running(stage.run.deadlines, stage.environment.clock())


def test_wait_inside_timeout_counts_both_down() -> None:
    stage = Stage("timeout: 5 s\nwait: 2 s")
    stage.tick()
    now = stage.environment.clock()
    assert running(stage) == [
        Countdown(path="tree", kind="wait", ends_at=now + 2.0),
        Countdown(path="tree@timeout", kind="timeout", ends_at=now + 5.0),
    ]


def test_retry_counts_remaining_attempts() -> None:
    stage = Stage("retry: {attempts: 3}\nsequence: [{wait: 1 s}, {check: scene.age > 4}]")
    stage.tick()
    assert running(stage)[-1] == Countdown(path="tree@retry", kind="retry", remaining=2)
    stage.after(1.0)
    stage.tick()
    assert running(stage)[-1] == Countdown(path="tree@retry", kind="retry", remaining=1)


def test_endless_repeat_has_no_countdown() -> None:
    stage = Stage("repeat: forever\nwait: 1 s")
    stage.tick()
    assert [one.kind for one in running(stage)] == ["wait"]


def test_cooldown_counts_down_while_its_child_is_idle() -> None:
    stage = Stage(
        "sequence: [{say: hello, cooldown: 30 s}, {say: good-bye}]",
        answers={"say": [ScriptedReply(), ScriptedReply(after_s=100.0)]},
    )
    stage.tick()
    [cooldown] = running(stage)
    assert (cooldown.path, cooldown.kind) == ("tree/0.say@cooldown", "cooldown")
    stage.after(31.0)
    assert running(stage) == []
