# SPDX-License-Identifier: Apache-2.0
"""Engine on a scripted environment: the behaviour of each node, tick by tick."""

from __future__ import annotations

import pytest

from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import FAILS, LONG, TreeHarness, scene, started


def test_check_fails_when_its_value_is_missing() -> None:
    harness = TreeHarness("check: scene.age > 2", awarded=scene(mood=3))
    assert harness.tick() == "failed"
    assert "'scene.age' has no value" in harness.message
    assert "a.yaml:" in harness.message


def test_running_wait_follows_tuned_duration() -> None:
    harness = TreeHarness(
        "wait: ${pause}",
        head="tunables: {pause: {default: 10 s, min: 1 s, max: 60 s, description: d}}",
    )
    assert harness.tick() == "running"
    assert harness.after(5.0) == "running"
    harness.tunables["pause"] = 6.0
    assert harness.after(0.5) == "running"
    assert harness.after(0.5) == "succeeded"


def test_condition_indexes_list_and_fails_out_of_range() -> None:
    tree = "wait_for: {topic: scan, type: sensor_msgs/msg/LaserScan, until: msg.ranges.1 < 1}"
    harness = TreeHarness(tree)
    assert harness.tick() == "running"
    harness.environment.arrive("scan", {"ranges": [0.2, 3.0]})
    assert harness.tick() == "running"
    harness.environment.arrive("scan", {"ranges": [3.0, 0.2]})
    assert harness.tick() == "succeeded"
    short = started(tree)
    short.environment.arrive("scan", {"ranges": [0.2]})
    assert short.tick() == "failed"


def test_raw_leaves_send_their_declared_fields() -> None:
    harness = TreeHarness(
        """
        sequence:
          - action: {name: /dock, type: test_msgs/action/Fibonacci, goal: {order: 3}}
          - service: {name: /reset, type: std_srvs/srv/Trigger}
          - publish: {topic: beep, type: std_msgs/msg/String, message: {data: "age ${scene.age}"}}
        """
    )
    assert harness.tick() == "succeeded"
    assert [(g.goal.name, g.goal.fields) for g in harness.environment.goals] == [
        ("/dock", {"order": 3}),
        ("/reset", {}),
    ]
    assert harness.environment.published[0].fields == {"data": "age 3"}


def test_timeout_halts_node_and_cancels_its_goal() -> None:
    harness = TreeHarness("say: long text\ntimeout: 2 s", answers={"say": LONG})
    assert harness.tick() == "running"
    assert harness.after(1.9) == "running"
    assert harness.after(0.1) == "failed"
    assert harness.environment.running() == []
    assert "not done within 2 s" in harness.message


def test_exhausted_retry_fails_with_last_reason() -> None:
    harness = TreeHarness("say: x\nretry: 2", answers={"say": FAILS})
    assert harness.tick(2) == "failed"
    assert len(harness.said) == 2
    assert "motor off" in harness.message


def test_on_failure_branch_replaces_failed_node() -> None:
    harness = TreeHarness("drive: x\non_failure: {say: sorry}", answers={"drive": FAILS})
    assert harness.tick() == "succeeded"
    assert harness.said == ["sorry"]


@pytest.mark.parametrize("composite", ["sequence", "selector"])
def test_child_whose_when_is_false_is_skipped(composite: str) -> None:
    harness = TreeHarness(
        f"""
        {composite}:
          - say: for old people
            when: scene.age > 4
          - say: for all
        """
    )
    assert harness.tick() == "succeeded"
    assert harness.said == ["for all"]


def test_when_is_evaluated_once_at_node_start() -> None:
    harness = TreeHarness(
        "say: x\nwhen: live.mood >= 3", answers={"say": [ScriptedReply(after_s=2.0)]}
    )
    assert harness.tick() == "running"
    harness.set_mood(1.0)
    assert harness.after(1.0) == "running"
    assert harness.after(1.0) == "succeeded"


def test_only_live_names_follow_the_live_scene() -> None:
    harness = TreeHarness(
        """
        sequence:
          - wait: 1 s
          - check: scene.mood == 3 and live.mood == 2 and mood.change == -1
        """
    )
    assert harness.tick() == "running"
    harness.set_mood(2.0)
    assert harness.after(1.0) == "succeeded"


def test_tick_reports_only_changes_in_order() -> None:
    harness = started(
        """
        sequence:
          - check: scene.age == 3
          - wait: 1 s
        """
    )
    assert [(c.path.rpartition("/")[2], c.status.name) for c in harness.changes] == [
        ("0.check", "SUCCESS"),
        ("1.wait", "RUNNING"),
        ("tree", "RUNNING"),
    ]
    harness.changes = []
    harness.tick()
    assert harness.changes == []


def test_raising_leaf_fails_with_path_and_file_position(monkeypatch: pytest.MonkeyPatch) -> None:
    harness = TreeHarness("sequence:\n  - say: x")

    def broken(goal: object) -> None:
        raise RuntimeError("cable cut")

    monkeypatch.setattr(harness.environment, "send", broken)
    assert harness.tick() == "failed"
    assert "RuntimeError: cable cut (tree/0.say, a.yaml:" in harness.message
