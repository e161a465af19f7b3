# SPDX-License-Identifier: Apache-2.0
"""Mood trace: which node of a tree a person's mood is credited to, on a manual clock."""

from __future__ import annotations

import math
from typing import Any

import pytest

from bt_agents_core.run_key import RunKey
from bt_agents_core.scene import Scene
from feedback_node.mood_trace import MOST_CHANGES, MOST_LEAVES, MOST_VALUES, MoodTrace, RunValues
from scene_spaces import AGE_AND_MOOD as SPACE
from scene_spaces import age_and_mood

NAN = math.nan


def scene(mood: float, **fields: Any) -> Scene:
    return age_and_mood(3.0, mood, **fields)


class Run:
    """A run whose lines are timed from its start."""

    def __init__(self, awarded: Scene, lease_s: float = 100.0) -> None:
        self.now = 0.0
        self.trace = MoodTrace(awarded, SPACE, lambda: self.now, lease_s)

    def on_leaf(self, at: float, leaf: str) -> None:
        self.now = at
        self.trace.on_leaf(leaf)

    def see(self, at: float, live: Scene) -> None:
        self.now = at
        self.trace.receive(live)

    def so_far(self, at: float) -> list[tuple[str, float, float, float]]:
        self.now = at
        return [(one.leaf, one.seconds, one.mean, one.change) for one in self.trace.so_far()]


def test_each_leaf_has_time_mean_mood_and_change():
    run = Run(scene(4.0))
    run.on_leaf(1.0, "tree/0.say")
    run.see(2.0, scene(4.0))
    run.on_leaf(3.0, "tree/1.ask")
    run.see(4.0, scene(2.0))
    run.see(6.0, scene(3.0))
    assert run.so_far(7.0) == [
        ("tree/0.say", 2.0, 4.0, 0.0),
        ("tree/1.ask", 4.0, pytest.approx((4.0 + 2 * 2.0 + 3.0) / 4), -1.0),
    ]


def test_turns_of_one_leaf_are_added_up():
    run = Run(scene(4.0))
    run.on_leaf(0.0, "ask")
    run.see(1.0, scene(3.0))
    run.on_leaf(2.0, "say")
    run.see(3.0, scene(5.0))
    run.on_leaf(4.0, "ask")
    run.see(5.0, scene(4.5))
    assert [(leaf, seconds, change) for leaf, seconds, _, change in run.so_far(6.0)] == [
        ("ask", 4.0, -1.5),
        ("say", 2.0, 2.0),
    ]


@pytest.mark.parametrize(
    "gap", [scene(NAN), scene(1.0, person=False), scene(1.0, person_id="ben")]
)
def test_lost_person_does_not_count_as_unhappy(gap):
    run = Run(scene(4.0, person_id="anna"))
    run.on_leaf(0.0, "say")
    run.see(1.0, gap)
    run.see(3.0, scene(3.5, person_id="anna"))
    assert run.so_far(4.0) == [("say", 4.0, pytest.approx(3.75), -0.5)]


def test_leaf_without_known_mood_has_none():
    run = Run(scene(NAN))
    run.on_leaf(0.0, "say")
    run.see(1.0, scene(NAN))
    unknown = pytest.approx(NAN, nan_ok=True)
    assert run.so_far(2.0) == [("say", 2.0, unknown, unknown)]


def test_mood_counts_no_longer_than_the_lease():
    run = Run(scene(NAN), lease_s=1.0)
    run.on_leaf(0.0, "say")
    run.see(0.0, scene(2.0))
    run.see(5.0, scene(4.0))
    assert run.so_far(6.0) == [("say", 6.0, pytest.approx(3.0), 2.0)]
    run.on_leaf(8.0, "ask")
    assert run.so_far(9.0)[1][1:3] == (1.0, pytest.approx(NAN, nan_ok=True))


@pytest.mark.parametrize(
    ("moment", "leaf"), [(0.5, ""), (1.0, "say"), (2.9, "say"), (3.0, "ask"), (99.0, "ask")]
)
def test_each_moment_belongs_to_the_leaf_running_then(moment, leaf):
    run = Run(scene(4.0))
    run.on_leaf(1.0, "say")
    run.on_leaf(2.0, "say")
    run.on_leaf(3.0, "ask")
    assert run.trace.leaf_at(moment) == leaf


def test_mood_trace_is_bounded():
    run = Run(scene(4.0))
    for number in range(MOST_CHANGES + 50):
        run.on_leaf(float(number), f"tree/{number}.say")
    assert len(run.trace.so_far()) == MOST_LEAVES
    assert run.trace.leaf_at(10.0) == ""
    assert run.trace.leaf_at(MOST_CHANGES + 20.5) == f"tree/{MOST_CHANGES + 20}.say"


def test_trace_keeps_last_values_of_latest_run() -> None:
    values, first, second = RunValues(), RunKey(epoch="m", round=1), RunKey(epoch="m", round=2)
    values.change(first, "tree/0.ask", "answer", "'no'")
    values.change(second, "tree/0.ask", "answer", "'yes'")
    values.change(second, "tree/0.ask", "answer", "'no'")
    assert values.of(first) == {}
    assert values.of(second) == {("tree/0.ask", "answer"): "'no'"}


def test_values_are_kept_up_to_a_bound() -> None:
    values, run = RunValues(), RunKey(epoch="m", round=1)
    for number in range(2 * MOST_VALUES):
        values.change(run, "tree", f"n{number}", "1")
    assert len(values.of(run)) == MOST_VALUES
