# SPDX-License-Identifier: Apache-2.0
"""Streams for the tools of py_trees_ros: when they open, what they send, and how long."""

from __future__ import annotations

import math

import pytest

from bt_agents.engine.value_trace import TracedValue, ValueTrace
from bt_agents.host.tree_streams.blackboard import activities, activity_table, chosen, table
from bt_agents.host.tree_streams.stream import (
    UNUSED_S,
    SnapshotParameters,
    SnapshotSchedule,
    StreamUse,
    TickStatistics,
)
from bt_agents.host.tree_streams.tree_snapshot import key_of, node_id
from bt_agents.host.tree_streams.watched_run import WatchedRun
from bt_agents_core.errors import Refused
from tree_harness import TreeHarness, started


def test_snapshot_is_due_on_change_or_near_period() -> None:
    schedule = SnapshotSchedule()
    assert schedule.take(0.0, changed=False, period_s=math.inf)
    assert not schedule.take(9.0, changed=False, period_s=10.0)
    assert schedule.take(9.81, changed=False, period_s=10.0)
    assert schedule.take(9.9, changed=True, period_s=math.inf)
    assert not schedule.take(1e9, changed=False, period_s=math.inf)


def test_unsubscribed_stream_ends_after_its_timeout() -> None:
    use = StreamUse(0.0)
    assert not use.is_over(UNUSED_S - 0.1)
    assert use.update(1, 9.0)
    assert not use.update(2, 20.0)
    assert not use.update(0, 21.0)
    assert not use.is_over(20.0 + UNUSED_S - 0.1)
    assert use.is_over(20.0 + UNUSED_S)
    assert use.update(1, 22.0), "a subscriber that comes back is a first one again"
    assert not StreamUse(0.0, kept=True).is_over(1e9)


@pytest.mark.parametrize("period_s", [math.nan, -1.0, -math.inf])
def test_invalid_snapshot_period_is_refused(period_s: float) -> None:
    with pytest.raises(Refused, match="expected a number of seconds"):
        SnapshotParameters(period_s=period_s, blackboard_data=False, blackboard_activity=False)


def test_statistics_cover_the_last_ten_ticks() -> None:
    ticks = TickStatistics()
    assert ticks.interval.average == 0.0
    ticks.add(100.0, 160.0)
    assert (ticks.interval.last, ticks.duration.variance) == (0.0, 0.0)
    for number in range(10):
        ticks.add(200.0 + number, 200.5 + number)
    assert (ticks.duration.last, ticks.duration.average, ticks.interval.last) == (0.5, 0.5, 1.0)
    assert ticks.interval.average == pytest.approx((100.0 + 9 * 1.0) / 10)
    assert ticks.interval.variance == pytest.approx(980.1)


def test_node_id_is_a_stable_uuid() -> None:
    first = node_id("guide", "tree/0.say")
    assert first == node_id("guide", "tree/0.say")
    assert first.version == 4
    assert len({first, node_id("guide", "tree/1.say"), node_id("other", "tree/0.say")}) == 3


def test_names_become_keys_with_slashes() -> None:
    assert [key_of(name) for name in ("scene.mood", "answer")] == ["/scene/mood", "/answer"]


def test_variables_are_filtered_by_name_and_visited_nodes() -> None:
    keys = ["/answer", "/scene/mood"]
    assert chosen([], keys, None) == keys
    assert chosen(["answer.text", "/nobody"], keys, None) == ["/answer.text", "/nobody"]
    assert chosen(["answer.text", "/nobody"], keys, {"/answer"}) == ["/answer.text"]
    assert chosen([], keys, {"/scene/mood"}) == ["/scene/mood"]


def test_first_write_of_key_is_shown_as_initialised() -> None:
    known: dict[str, str] = {}
    found = activities(
        [
            TracedValue("tree/0.set", "word", "a", True),
            TracedValue("tree/1.say", "word", "a", False),
            TracedValue("tree/2.set", "word", "b", True),
        ],
        known,
    )
    assert activity_table(found).splitlines() == [
        "    /word : INITIALISED | tree/0.set | 'a'",
        "    /word : READ | tree/1.say | 'a'",
        "    /word : WRITE | tree/2.set | 'a' → 'b'",
    ]
    assert known == {"/word": "'b'"}


def test_table_aligns_its_values() -> None:
    assert table([("/a", "1"), ("/long", "2")]) == "    /a    : 1\n    /long : 2"
    assert table([]) == ""


def active(watched: WatchedRun) -> list[str]:
    return [node.path for node, state in watched.nodes() if state.active and node.path]


def test_nodes_ticked_after_breakpoint_removal_are_active() -> None:
    harness = TreeHarness("sequence: [{wait: 1 s}, {wait: 1 s}]")
    watched = WatchedRun(harness.run)
    harness.run.set_breakpoints(["tree/0.wait"])
    watched.note(visits=True, activity=False)
    harness.tick()
    watched.take_tick(0.0, 0.1)
    assert harness.run.held == ("tree/0.wait",)
    harness.run.set_breakpoints([])
    harness.tick(2, step_s=1.0)
    watched.take_tick(1.0, 1.1)
    assert active(watched) == ["tree", "tree/0.wait", "tree/1.wait"]
    assert watched.changed
    harness.tick()
    watched.take_tick(2.0, 2.1)
    assert active(watched) == ["tree", "tree/1.wait"]
    assert not watched.changed


def test_tree_ticks_normally_after_last_watcher_leaves() -> None:
    harness = started("sequence: [{wait: 1 s}, {wait: 1 s}]")
    watched = WatchedRun(harness.run)
    changes = len(harness.changes)
    watched.note(visits=True, activity=True)
    harness.tick()
    watched.note(visits=False, activity=False)
    watched.take_tick(0.0, 0.1)
    harness.tick()
    assert len(harness.changes) == changes, "watching a tree repeats its changes"
    assert not watched.activity
    assert active(watched) == ["tree", "tree/0.wait"]


def test_two_traces_close_in_any_order() -> None:
    harness = TreeHarness("sequence: [{set: {word: a}}, {wait: 1 s}]")
    scopes = [vars(node).get("scope") for node in harness.root.iterate()]
    first = ValueTrace(harness.root)
    second = ValueTrace(harness.root, repeated=True)
    first.close()
    harness.tick()
    assert [one.name for one in second.take()] == ["word"]
    assert first.take() == []
    second.close()
    assert {id(node.fields.names) for node in harness.root.iterate()} == {id(harness.run.scope)}
    assert [vars(node).get("scope") for node in harness.root.iterate()] == scopes
