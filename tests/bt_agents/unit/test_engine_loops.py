# SPDX-License-Identifier: Apache-2.0
"""Retry and repeat with pauses, limits and ends, tick by tick."""

from __future__ import annotations

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import Stage, scene

FAILED = ScriptedReply(state=GoalState.ABORTED, message="motor off")
FAILS = [FAILED]
LONG = [ScriptedReply(after_s=100.0)]
TUNABLE = "tunables: {n: {default: 2, min: 1, max: 9, description: d}}"
REST = "tunables: {rest: {default: 2 s, min: 0 s, max: 60 s, description: d}}"


def test_a_retry_pauses_between_the_attempts() -> None:
    #  t | drive | retry
    #  0 |   F   |   R     attempt 1
    #  1 |       |   R     pause
    #  2 |   F   |   R     attempt 2
    #  4 |   S   |   S     attempt 3
    stage = Stage(
        "drive: x\nretry: {attempts: 3, pause: 2 s}",
        answers={"drive": [FAILED, FAILED, ScriptedReply()]},
    )
    assert stage.tick() == "running"
    assert stage.status("tree@retry") == "RUNNING"
    assert stage.status("tree") == "FAILURE"
    assert stage.run.tip == "tree@retry"
    assert stage.after(1.9) == "running"
    assert len(stage.asked) == 1
    assert stage.after(0.1) == "running"
    assert len(stage.asked) == 2
    assert stage.after(2.0) == "succeeded"
    assert len(stage.asked) == 3


def test_a_retry_says_which_attempt_it_is() -> None:
    stage = Stage(
        "drive: x\nretry: {attempts: 2, pause: 2 s}",
        answers={"drive": [FAILED, ScriptedReply(after_s=1.0)]},
    )
    stage.tick()
    stage.after(2.0)
    stage.after(1.0)
    assert stage.reports("tree@retry") == [
        ("RUNNING", "attempt 2 of 2, after a pause of 2 s"),
        ("RUNNING", "attempt 2 of 2"),
        ("SUCCESS", ""),
    ]


def test_without_a_pause_the_next_attempt_comes_at_the_next_tick_and_not_within_one() -> None:
    stage = Stage("drive: x\nretry: forever", answers={"drive": FAILS})
    for number in range(1, 6):
        assert stage.tick() == "running"
        assert len(stage.asked) == number


def test_a_retry_for_ever_ends_with_a_success() -> None:
    stage = Stage(
        "drive: x\nretry: {attempts: forever, pause: 1 s}",
        answers={"drive": [*FAILS * 20, ScriptedReply()]},
    )
    assert stage.tick(20, step_s=1.0) == "running"
    assert stage.after(1.0) == "succeeded"
    assert len(stage.asked) == 21


def test_a_pause_may_be_tuned_while_it_passes() -> None:
    stage = Stage(
        "drive: x\nretry: {attempts: 5, pause: '${rest}'}", head=REST, answers={"drive": FAILS}
    )
    stage.tick()
    stage.after(1.0)
    stage.tunables["rest"] = 1.0
    stage.tick()
    assert len(stage.asked) == 2
    stage.tunables["rest"] = -3.0
    assert stage.tick() == "failed"
    assert "expected a time such as '5 s'" in stage.message
    assert "(tree@retry, a.yaml:" in stage.message


def test_a_pause_that_is_tuned_after_it_is_over_does_not_hold_up_the_attempt() -> None:
    stage = Stage(
        "drive: x\nretry: {attempts: 2, pause: '${rest}'}",
        head=REST,
        answers={"drive": [FAILED, ScriptedReply(after_s=2.0)]},
    )
    stage.tick()
    stage.after(2.0)
    stage.tunables["rest"] = 60.0
    assert stage.run.tip == "tree"
    assert stage.after(2.0) == "succeeded"


def test_the_number_of_attempts_is_looked_at_when_an_attempt_has_failed() -> None:
    stage = Stage("drive: x\nretry: ${n}", head=TUNABLE, answers={"drive": FAILS})
    assert stage.tick() == "running"
    stage.tunables["n"] = 4
    assert stage.tick(2) == "running"
    stage.tunables["n"] = 1
    assert stage.tick() == "failed"
    assert len(stage.asked) == 4


@pytest.mark.parametrize("value", [0, -1, 1.5, float("nan"), float("inf"), True, "two", None])
def test_counts_that_are_none_are_refused_in_words(value: object) -> None:
    for tree, answers in (
        ("drive: x\nretry: ${n}", FAILS),
        ("drive: x\nrepeat: ${n}", [ScriptedReply()]),
    ):
        stage = Stage(tree, head=TUNABLE, answers={"drive": answers})
        stage.tunables["n"] = value  # type: ignore[assignment]
        stage.tick()
        assert stage.outcome == "failed"
        assert "expected a whole number from 1 on" in stage.message


def test_a_computed_count_may_come_out_as_a_whole_number_with_a_point() -> None:
    stage = Stage("drive: x\nretry: ${n * 3 / 2}", head=TUNABLE, answers={"drive": FAILS})
    assert stage.tick(3) == "failed"
    assert len(stage.asked) == 3


def test_a_single_attempt_says_that_it_failed_once() -> None:
    stage = Stage("say: x\ntimeout: 0 s\nretry: 1", answers={"say": LONG})
    assert stage.tick() == "failed"
    assert stage.reports("tree@retry")[-1][1].startswith("failed once (tree@retry")


def test_a_retry_that_was_stopped_counts_from_the_beginning() -> None:
    stage = Stage("drive: x\nretry: {attempts: 2, pause: 5 s}", answers={"drive": FAILS})
    stage.tick()
    stage.interrupt()
    assert {node.status.name for node in stage.root.iterate()} == {"INVALID"}
    assert stage.tick() == "running"
    assert len(stage.asked) == 2
    assert stage.after(5.0) == "failed"
    assert len(stage.asked) == 3


def test_a_cancel_in_a_pause_ends_the_run_at_once() -> None:
    stage = Stage("drive: x\nretry: {attempts: 9, pause: 1 h}", answers={"drive": FAILS})
    stage.tick()
    stage.run.cancel("enough")
    assert stage.outcome == "cancelled"


def test_a_repeat_pauses_between_its_rounds_and_not_after_the_last() -> None:
    #  t | say | repeat
    #  0 |  S  |   R
    #  5 |  S  |   R
    # 10 |  S  |   S
    stage = Stage("say: x\nrepeat: {times: 3, pause: 5 s}")
    assert stage.tick() == "running"
    assert stage.after(4.9) == "running"
    assert stage.after(0.1) == "running"
    assert len(stage.said) == 2
    assert stage.after(5.0) == "succeeded"
    assert len(stage.said) == 3


def test_a_repeat_ends_with_the_first_failure() -> None:
    stage = Stage(
        "drive: x\nrepeat: forever", answers={"drive": [ScriptedReply(), ScriptedReply(), *FAILS]}
    )
    assert stage.tick(2) == "running"
    assert stage.tick() == "failed"
    assert stage.message == "drive aborted: motor off"


def test_a_repeat_until_looks_after_each_success_and_after_the_pause() -> None:
    stage = Stage("say: x\nrepeat: {until: live.mood >= 4, pause: 1 s}")
    assert stage.tick(3, step_s=1.0) == "running"
    stage.set_mood(5.0)
    assert stage.tick() == "running"
    assert stage.after(1.0) == "succeeded"
    assert len(stage.said) == 3


def test_a_repeat_until_without_a_pause_looks_before_the_next_round() -> None:
    stage = Stage("say: x\nrepeat: {until: live.mood >= 4}")
    assert stage.tick() == "running"
    stage.set_mood(5.0)
    assert stage.tick() == "succeeded"
    assert len(stage.said) == 1


def test_a_repeat_until_something_that_is_so_already_is_done_once() -> None:
    stage = Stage("say: x\nrepeat: {times: 5, until: scene.age == 3}")
    assert stage.tick() == "succeeded"
    assert len(stage.said) == 1


def test_an_until_that_misses_a_value_is_not_so_yet_an_undecided_one_fails() -> None:
    stage = Stage("say: x\nrepeat: {until: live.age >= 4}", awarded=scene(mood=3))
    assert stage.tick(2) == "running"
    stage.set_live("age", 4.0)
    assert stage.tick() == "succeeded"
    stage = Stage("say: x\nrepeat: {until: 1 / live.mood > 0}", awarded=scene(mood=0))
    assert stage.tick() == "failed"
    assert "by zero" in stage.message


def test_a_repeat_with_a_number_and_an_until_succeeds_after_so_many_rounds_too() -> None:
    stage = Stage("say: x\nrepeat: {times: 3, until: live.mood > 4}")
    assert stage.tick(3) == "succeeded"
    assert len(stage.said) == 3


def test_an_until_can_ask_for_what_the_round_has_found_out() -> None:
    stage = Stage(
        "ask: Ready?\nrepeat: {until: answer == 'yes'}",
        answers={
            "ask": [
                ScriptedReply(result={"answer": "no"}),
                ScriptedReply(result={"answer": "yes"}),
            ]
        },
    )
    assert stage.tick() == "running"
    assert stage.tick() == "succeeded"


def test_a_timeout_counts_for_each_attempt_of_a_retry() -> None:
    stage = Stage("say: x\ntimeout: 2 s\nretry: {attempts: 2, pause: 9 s}", answers={"say": LONG})
    stage.tick()
    assert stage.after(2.0) == "running"
    assert stage.environment.running() == []
    stage.after(9.0)
    assert stage.environment.running() == ["say"]
    assert stage.after(2.0) == "failed"
    assert len(stage.said) == 2


def test_a_retry_around_a_repeat_starts_the_count_of_rounds_afresh() -> None:
    stage = Stage(
        "drive: x\nrepeat: 2\nretry: 2",
        answers={"drive": [ScriptedReply(), FAILED, ScriptedReply()]},
    )
    assert stage.tick(3) == "running"
    assert stage.tick() == "succeeded"
    assert len(stage.asked) == 4
