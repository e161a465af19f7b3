# SPDX-License-Identifier: Apache-2.0
"""Engine on a scripted environment: leaves, values and parallel children, tick by tick."""

from __future__ import annotations

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import TreeHarness, failure, started


@pytest.mark.parametrize(
    ("ranges", "outcome"), [([0.2, 3.0], "running"), ([3.0, 0.2], "succeeded"), ([0.2], "failed")]
)
def test_condition_indexes_list_and_fails_out_of_range(ranges: list[float], outcome: str) -> None:
    harness = started(
        "wait_for: {topic: scan, type: sensor_msgs/msg/LaserScan, until: msg.ranges.1 < 1}"
    )
    harness.environment.arrive("scan", {"ranges": ranges})
    assert harness.tick() == outcome


def test_skill_fails_when_its_result_condition_is_false() -> None:
    failure("ask: Where to?", answers={"ask": [ScriptedReply(result={"answer": ""})]})


def test_raw_leaves_send_their_declared_fields() -> None:
    harness = started(
        """
        sequence:
          - action: {name: /dock, type: test_msgs/action/Fibonacci, goal: {order: 3}}
          - service: {name: /reset, type: std_srvs/srv/Trigger}
          - publish: {topic: beep, type: std_msgs/msg/String, message: {data: "age ${scene.age}"}}
        """
    )
    sent = [(one.goal.name, one.goal.fields) for one in harness.environment.goals]
    assert sent == [("/dock", {"order": 3}), ("/reset", {})]
    assert harness.environment.published[0].fields == {"data": "age 3"}


def test_when_is_evaluated_once_at_node_start() -> None:
    harness = started(
        "say: x\nwhen: live.mood >= 3", answers={"say": [ScriptedReply(after_s=2.0)]}
    )
    harness.set_mood(1.0)
    assert harness.outcomes(1, 1) == "RS"


def test_only_live_names_follow_the_live_scene() -> None:
    condition = "scene.mood == 3 and live.mood == 2 and mood.change == -1"
    harness = started(f"sequence: [{{wait: 1 s}}, {{check: {condition}}}]")
    harness.set_mood(2.0)
    assert harness.after(1.0) == "succeeded"


def test_tick_reports_only_changes_in_order() -> None:
    harness = started("sequence: [{check: scene.age == 3}, {wait: 1 s}]")
    harness.tick()
    assert [(c.path.rpartition("/")[2], c.status.name) for c in harness.changes] == [
        ("0.check", "SUCCESS"),
        ("1.wait", "RUNNING"),
        ("tree", "RUNNING"),
    ]


STATES = {"S": GoalState.SUCCEEDED, "F": GoalState.ABORTED}


def parallel(succeed_on: str, ends: str) -> TreeHarness:
    """Return a parallel of say, show and drive; ``F2`` means that one fails after 2 s."""
    tree = f"parallel: {{succeed_on: {succeed_on}, children: [say: x, show: y, drive: z]}}"
    replies = [
        [ScriptedReply(after_s=float(end[1:]), state=STATES[end[0]])] for end in ends.split()
    ]
    return TreeHarness(tree, answers=dict(zip(("say", "show", "drive"), replies, strict=True)))


@pytest.mark.parametrize(
    ("succeed_on", "ends", "outcomes"),
    [
        ("2", "S1 S2 S9", "RRS"),
        ("2", "F1 S2 S3", "RRRS"),
        ("2", "F1 F2 S9", "RRF"),
        ("one", "F1 F2 S3", "RRRS"),
        ("one", "F1 F2 F3", "RRRF"),
        ("all", "S1 F2 S9", "RRF"),
        ("one", "S0 S9 S9", "S"),
    ],
)
def test_parallel_ends_once_its_outcome_is_certain(
    succeed_on: str, ends: str, outcomes: str
) -> None:
    harness = parallel(succeed_on, ends)
    assert harness.outcomes(0, *[1] * len(outcomes[1:])) == outcomes
    assert harness.environment.running() == []
    assert harness.asked == ["say", "show", "drive"]


def test_failed_parallel_names_child_and_missing_successes() -> None:
    harness = parallel("2", "F0 F1 S9")
    harness.tick()
    assert harness.after(1.0) == "failed"
    assert harness.reports("tree")[-1] == ("FAILURE", "2 had to succeed, at most 1 still can")
    assert harness.result.tip == "tree/1.show"
    assert harness.status("2.drive") == "INVALID"
