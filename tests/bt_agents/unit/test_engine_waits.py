# SPDX-License-Identifier: Apache-2.0
"""Waits for conditions and messages: holding times and remembered messages."""

from __future__ import annotations

import pytest

from tree_harness import TreeHarness, scene, started

CONDITION = "wait_for: {condition: live.mood >= 4, for: 2 s}"
MESSAGE = "{topic: t, type: std_msgs/msg/Int32, until: msg.data > 3, for: 2 s, outputs: {n: data}}"


def test_wait_for_ends_when_its_condition_holds() -> None:
    harness = TreeHarness("wait_for: live.mood >= 4")
    assert harness.tick(3, step_s=1.0) == "running"
    harness.set_mood(4.0)
    assert harness.tick() == "succeeded"
    assert TreeHarness("wait_for: scene.mood == 3").tick() == "succeeded"


def test_condition_must_hold_without_interruption() -> None:
    #  t   | mood | held | wait_for
    #  0   |  3   |  -   |   R
    #  1   |  4   |  0   |   R
    #  2   |  3   |  -   |   R      a break
    #  3   |  4   |  0   |   R
    #  4.9 |  4   |  1.9 |   R
    #  5   |  4   |  2   |   S
    harness = started(CONDITION)
    for mood in (4.0, 3.0, 4.0):
        harness.set_mood(mood)
        assert harness.after(1.0) == "running"
    assert harness.after(1.9) == "running"
    assert harness.after(0.1) == "succeeded"


def test_missing_value_resets_the_hold_time() -> None:
    harness = TreeHarness(CONDITION, awarded=scene(age=3))
    assert harness.tick() == "running"
    assert harness.reports("tree") == [("RUNNING", "'live.mood' has no value yet")]
    harness.set_mood(5.0)
    harness.tick()
    harness.live = scene(age=3)
    harness.after(1.5)
    harness.set_mood(5.0)
    assert harness.after(1.0) == "running"
    assert harness.after(2.0) == "succeeded"


def test_hold_time_is_tunable_and_restarts_after_interruption() -> None:
    harness = started(
        "wait_for: {condition: live.mood >= 3, for: '${hold}'}",
        head="tunables: {hold: {default: 9 s, min: 0 s, max: 60 s, description: d}}",
    )
    harness.after(8.0)
    harness.interrupt()
    assert harness.after(1.0) == "running"
    assert harness.after(8.0) == "running"
    harness.tunables["hold"] = 8.0
    assert harness.tick() == "succeeded"


def test_mismatching_message_resets_hold_time() -> None:
    #  t | messages | held | wait_for
    #  0 |          |  -   |   R
    #  1 |   5      |  0   |   R
    #  2 |   1      |  -   |   R
    #  3 |   2, 6   |  0   |   R
    #  4 |   7      |  1   |   R
    #  5 |          |  2   |   S     n = 7
    harness = started(f"sequence:\n  - wait_for: {MESSAGE}\n  - say: Got ${{n}}.")
    for numbers in ([5], [1], [2, 6], [7]):
        for number in numbers:
            harness.environment.arrive("t", {"data": number})
        assert harness.after(1.0) == "running"
    assert harness.after(1.0) == "succeeded"
    assert harness.said == ["Got 7."]


def test_mismatch_in_the_final_tick_resets_hold_time() -> None:
    harness = started(f"wait_for: {MESSAGE}")
    harness.environment.arrive("t", {"data": 5})
    harness.tick()
    for number in (7, 1):
        harness.environment.arrive("t", {"data": number})
    assert harness.after(2.0) == "running"


def test_first_matching_message_wins_without_hold_time() -> None:
    harness = started(
        """
        sequence:
          - wait_for:
              topic: t
              type: std_msgs/msg/Int32
              until: msg.data > 3
              outputs: {n: data}
          - say: Got ${n}.
        """
    )
    for number in (1, 4, 2, 9):
        harness.environment.arrive("t", {"data": number})
    assert harness.tick() == "succeeded"
    assert harness.said == ["Got 4."]


def test_waiting_node_says_why_nothing_arrives() -> None:
    harness = started("wait_for: {topic: t, type: std_msgs/msg/Int32, until: msg.data > 3}")
    [(_, inbox)] = harness.environment._inboxes
    inbox.problem = "t is published as std_msgs/msg/String, expected std_msgs/msg/Int32"
    harness.tick()
    assert harness.root.feedback_message == inbox.problem
    inbox.problem = ""
    harness.tick()
    assert harness.root.feedback_message == ""


def test_wait_for_fails_when_output_field_is_missing() -> None:
    harness = started(
        "wait_for: {topic: t, type: std_msgs/msg/Int32, outputs: {n: data, m: other}}"
    )
    harness.environment.arrive("t", {"data": 3})
    assert harness.tick() == "failed"
    assert "'msg.other' has no value" in harness.message


@pytest.mark.parametrize("end", ["success", "interrupt", "cancel", "failure"])
def test_wait_for_closes_its_inbox_at_end(end: str) -> None:
    harness = started("wait_for: {topic: t, type: std_msgs/msg/Bool, until: msg.data}")
    [(_, inbox)] = harness.environment._inboxes
    assert not inbox.closed
    if end == "interrupt":
        harness.interrupt()
    elif end == "cancel":
        harness.run.cancel("enough")
    else:
        harness.environment.arrive("t", {"data": True} if end == "success" else {})
        harness.tick()
    assert inbox.closed


def test_messages_before_start_are_ignored() -> None:
    harness = started(
        "sequence:\n  - wait: 1 s\n  - wait_for: {topic: t, type: std_msgs/msg/Empty}"
    )
    harness.environment.arrive("t", {})
    assert harness.after(1.0) == "running"
    harness.interrupt()
    harness.environment.arrive("t", {})
    harness.tick()
    assert harness.after(1.0) == "running"
    harness.environment.arrive("t", {})
    assert harness.tick() == "succeeded"


def test_wait_reports_its_condition_only_once() -> None:
    # tick     0        1        2        3
    # mood     3        3.1      3.2      3.3
    # told     ▶        –        –        –
    harness = TreeHarness("{wait_for: live.mood > 4, timeout: 10 s}")
    for number in range(4):
        harness.set_mood(3 + number / 10)
        harness.tick() if number == 0 else harness.after(1.0)
    told = [change.message for change in harness.changes if change.path == "tree"]
    assert told == ["not so yet: live.mood > 4 (live.mood is 3)"]
    harness.set_mood(3.5)
    harness.after(10.0)
    assert harness.message.startswith(
        "not done within 10 s: not so yet: live.mood > 4 (live.mood is 3.5) (tree@timeout"
    )
