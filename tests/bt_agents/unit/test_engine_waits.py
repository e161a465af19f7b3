# SPDX-License-Identifier: Apache-2.0
"""Waits for conditions and messages: holding times and remembered messages."""

from __future__ import annotations

from tree_harness import TreeHarness, scene, started

CONDITION = "wait_for: {condition: live.mood >= 4, for: 2 s}"
MESSAGE = "{topic: t, type: std_msgs/msg/Int32, until: msg.data > 3, for: 2 s, outputs: {n: data}}"


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
    assert harness.outcomes(1.9, 0.1) == "RS"


def test_missing_value_resets_the_hold_time() -> None:
    harness = started(CONDITION, awarded=scene(age=3))
    assert harness.reports("tree") == [("RUNNING", "'live.mood' has no value yet")]
    harness.set_mood(5.0)
    harness.tick()
    harness.live = scene(age=3)
    harness.after(1.5)
    harness.set_mood(5.0)
    assert harness.outcomes(1, 2) == "RS"


def test_hold_time_is_tunable_and_restarts_after_interruption() -> None:
    harness = started(
        "wait_for: {condition: live.mood >= 3, for: '${hold}'}",
        head="tunables: {hold: {default: 9 s, min: 0 s, max: 60 s, description: d}}",
    )
    harness.after(8.0)
    harness.interrupt()
    assert harness.outcomes(1, 8) == "RR"
    harness.tunables["hold"] = 8.0
    assert harness.tick() == "succeeded"


def arrive(harness: TreeHarness, *numbers: int) -> None:
    for number in numbers:
        harness.environment.arrive("t", {"data": number})


def test_mismatching_message_resets_hold_time() -> None:
    #  t | messages | held | wait_for
    #  0 |          |  -   |   R
    #  1 |   5      |  0   |   R
    #  2 |   1      |  -   |   R
    #  3 |   2, 6   |  0   |   R
    #  4 |   7      |  1   |   R
    #  5 |          |  2   |   S     n = 7
    harness = started(f"sequence: [{{wait_for: {MESSAGE}}}, {{say: 'Got ${{n}}.'}}]")
    for numbers in ([5], [1], [2, 6], [7]):
        arrive(harness, *numbers)
        assert harness.after(1.0) == "running"
    assert (harness.after(1.0), harness.said) == ("succeeded", ["Got 7."])


def test_mismatch_in_the_final_tick_resets_hold_time() -> None:
    harness = started(f"wait_for: {MESSAGE}")
    arrive(harness, 5)
    harness.tick()
    arrive(harness, 7, 1)
    assert harness.after(2.0) == "running"


def test_first_matching_message_wins_without_hold_time() -> None:
    wait = f"{{wait_for: {MESSAGE.replace(', for: 2 s', '')}}}"
    harness = started(f"sequence: [{wait}, {{say: 'Got ${{n}}.'}}]")
    arrive(harness, 1, 4, 2, 9)
    assert (harness.tick(), harness.said) == ("succeeded", ["Got 4."])


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
    arrive(harness, 3)
    assert harness.tick() == "failed"
    assert "'msg.other' has no value" in harness.message


def test_messages_before_start_are_ignored() -> None:
    harness = started("sequence: [{wait: 1 s}, {wait_for: {topic: t, type: std_msgs/msg/Empty}}]")
    harness.environment.arrive("t", {})
    assert harness.after(1.0) == "running"
    harness.interrupt()
    harness.environment.arrive("t", {})
    assert harness.outcomes(0, 1) == "RR"
    harness.environment.arrive("t", {})
    assert harness.tick() == "succeeded"


def test_wait_reports_its_condition_only_once() -> None:
    # tick     0        1        2        3
    # mood     3        3.1      3.2      3.3
    # told     ▶        –        –        –
    harness = started("{wait_for: live.mood > 4, timeout: 10 s}")
    for mood in (3.1, 3.2, 3.3):
        harness.set_mood(mood)
        harness.after(1.0)
    told = [change.message for change in harness.changes if change.path == "tree"]
    assert told == ["not so yet: live.mood > 4 (live.mood is 3)"]
    harness.set_mood(3.5)
    harness.after(10.0)
    assert harness.message.startswith(
        "not done within 10 s: not so yet: live.mood > 4 (live.mood is 3.5) (tree@timeout"
    )


def test_fast_messages_are_explained_once_a_second() -> None:
    harness = started(f"{{wait_for: {MESSAGE}, timeout: 2 s}}")
    for number in range(-6, 0):
        arrive(harness, number)
        harness.after(0.25)
    told = [change.message for change in harness.changes if change.path == "tree"]
    assert [text for text in told if text] == [
        f"the last message is not so: msg.data > 3 (msg.data is {number})" for number in (-6, -2)
    ]
    harness.after(0.5)
    assert "(msg.data is -1)" in harness.message
