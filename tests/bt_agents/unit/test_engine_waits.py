# SPDX-License-Identifier: Apache-2.0
"""Waiting for conditions and messages: how long they must hold, and what is remembered."""

from __future__ import annotations

import pytest

from tree_harness import Stage, scene

CONDITION = "wait_for: {condition: live.mood >= 4, for: 2 s}"
MESSAGE = "{topic: t, type: std_msgs/msg/Int32, until: msg.data > 3, for: 2 s, outputs: {n: data}}"


def test_wait_for_ends_when_its_condition_holds() -> None:
    stage = Stage("wait_for: live.mood >= 4")
    assert stage.tick(3, step_s=1.0) == "running"
    stage.set_mood(4.0)
    assert stage.tick() == "succeeded"
    assert Stage("wait_for: scene.mood == 3").tick() == "succeeded"


def test_condition_must_hold_without_interruption() -> None:
    #  t   | mood | held | wait_for
    #  0   |  3   |  -   |   R
    #  1   |  4   |  0   |   R
    #  2   |  3   |  -   |   R      a break
    #  3   |  4   |  0   |   R
    #  4.9 |  4   |  1.9 |   R
    #  5   |  4   |  2   |   S
    stage = Stage(CONDITION)
    stage.tick()
    for mood in (4.0, 3.0, 4.0):
        stage.set_mood(mood)
        assert stage.after(1.0) == "running"
    assert stage.after(1.9) == "running"
    assert stage.after(0.1) == "succeeded"


def test_missing_value_resets_the_hold_time() -> None:
    stage = Stage(CONDITION, awarded=scene(age=3))
    assert stage.tick() == "running"
    assert stage.reports("tree") == [("RUNNING", "'live.mood' has no value yet")]
    stage.set_mood(5.0)
    stage.tick()
    stage.live = scene(age=3)
    stage.after(1.5)
    stage.set_mood(5.0)
    assert stage.after(1.0) == "running"
    assert stage.after(2.0) == "succeeded"


def test_wait_for_fails_if_condition_cannot_be_evaluated() -> None:
    stage = Stage("wait_for: 1 / live.mood > 0", awarded=scene(mood=0))
    assert stage.tick() == "failed"
    assert "by zero" in stage.message


def test_hold_time_is_tunable_and_restarts_after_interruption() -> None:
    stage = Stage(
        "wait_for: {condition: live.mood >= 3, for: '${hold}'}",
        head="tunables: {hold: {default: 9 s, min: 0 s, max: 60 s, description: d}}",
    )
    stage.tick()
    stage.after(8.0)
    stage.interrupt()
    assert stage.after(1.0) == "running"
    assert stage.after(8.0) == "running"
    stage.tunables["hold"] = 8.0
    assert stage.tick() == "succeeded"


def test_mismatching_message_resets_hold_time() -> None:
    #  t | messages | held | wait_for
    #  0 |          |  -   |   R
    #  1 |   5      |  0   |   R
    #  2 |   1      |  -   |   R
    #  3 |   2, 6   |  0   |   R
    #  4 |   7      |  1   |   R
    #  5 |          |  2   |   S     n = 7
    stage = Stage(f"sequence:\n  - wait_for: {MESSAGE}\n  - say: Got ${{n}}.")
    stage.tick()
    for numbers in ([5], [1], [2, 6], [7]):
        for number in numbers:
            stage.environment.arrive("t", {"data": number})
        assert stage.after(1.0) == "running"
    assert stage.after(1.0) == "succeeded"
    assert stage.said == ["Got 7."]


def test_mismatch_in_the_final_tick_resets_hold_time() -> None:
    stage = Stage(f"wait_for: {MESSAGE}")
    stage.tick()
    stage.environment.arrive("t", {"data": 5})
    stage.tick()
    for number in (7, 1):
        stage.environment.arrive("t", {"data": number})
    assert stage.after(2.0) == "running"


def test_first_matching_message_wins_without_hold_time() -> None:
    stage = Stage(
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
    stage.tick()
    for number in (1, 4, 2, 9):
        stage.environment.arrive("t", {"data": number})
    assert stage.tick() == "succeeded"
    assert stage.said == ["Got 4."]


def test_any_message_ends_wait_without_condition() -> None:
    stage = Stage("wait_for: {topic: t, type: std_msgs/msg/Empty}")
    assert stage.tick() == "running"
    stage.environment.arrive("t", {})
    assert stage.tick() == "succeeded"


def test_wait_for_fails_when_output_field_is_missing() -> None:
    stage = Stage("wait_for: {topic: t, type: std_msgs/msg/Int32, outputs: {n: data, m: other}}")
    stage.tick()
    stage.environment.arrive("t", {"data": 3})
    assert stage.tick() == "failed"
    assert "'msg.other' has no value" in stage.message


@pytest.mark.parametrize("end", ["success", "interrupt", "cancel", "failure"])
def test_wait_for_closes_its_inbox_at_end(end: str) -> None:
    stage = Stage("wait_for: {topic: t, type: std_msgs/msg/Bool, until: msg.data}")
    stage.tick()
    [(_, inbox)] = stage.environment._inboxes
    assert not inbox.closed
    if end == "interrupt":
        stage.interrupt()
    elif end == "cancel":
        stage.run.cancel("enough")
    else:
        stage.environment.arrive("t", {"data": True} if end == "success" else {})
        stage.tick()
    assert inbox.closed


def test_messages_before_start_are_ignored() -> None:
    stage = Stage("sequence:\n  - wait: 1 s\n  - wait_for: {topic: t, type: std_msgs/msg/Empty}")
    stage.tick()
    stage.environment.arrive("t", {})
    assert stage.after(1.0) == "running"
    stage.interrupt()
    stage.environment.arrive("t", {})
    stage.tick()
    assert stage.after(1.0) == "running"
    stage.environment.arrive("t", {})
    assert stage.tick() == "succeeded"


def test_wait_reports_its_condition_only_once() -> None:
    # tick     0        1        2        3
    # mood     3        3.1      3.2      3.3
    # told     ▶        –        –        –
    stage = Stage("{wait_for: live.mood > 4, timeout: 10 s}")
    for number in range(4):
        stage.set_mood(3 + number / 10)
        stage.tick() if number == 0 else stage.after(1.0)
    told = [change.message for change in stage.changes if change.path == "tree"]
    assert told == ["not so yet: live.mood > 4 (live.mood is 3)"]
    stage.set_mood(3.5)
    stage.after(10.0)
    assert stage.run.result is not None
    assert "not so yet: live.mood > 4 (live.mood is 3.5)" in stage.run.result.message
