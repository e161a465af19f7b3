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


def test_retry_pauses_between_attempts() -> None:
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


def test_retry_reports_its_attempt_number() -> None:
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


def test_retry_without_pause_makes_one_attempt_per_tick() -> None:
    stage = Stage("drive: x\nretry: forever", answers={"drive": FAILS})
    for number in range(1, 6):
        assert stage.tick() == "running"
        assert len(stage.asked) == number


def test_endless_retry_ends_at_first_success() -> None:
    stage = Stage(
        "drive: x\nretry: {attempts: forever, pause: 1 s}",
        answers={"drive": [*FAILS * 20, ScriptedReply()]},
    )
    assert stage.tick(20, step_s=1.0) == "running"
    assert stage.after(1.0) == "succeeded"
    assert len(stage.asked) == 21


def test_running_pause_follows_tuned_duration() -> None:
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


def test_tuning_an_elapsed_pause_does_not_delay_attempt() -> None:
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


def test_attempt_limit_is_evaluated_after_each_failure() -> None:
    stage = Stage("drive: x\nretry: ${n}", head=TUNABLE, answers={"drive": FAILS})
    assert stage.tick() == "running"
    stage.tunables["n"] = 4
    assert stage.tick(2) == "running"
    stage.tunables["n"] = 1
    assert stage.tick() == "failed"
    assert len(stage.asked) == 4


@pytest.mark.parametrize("value", [0, -1, 1.5, float("nan"), float("inf"), True, "two", None])
def test_invalid_count_fails_with_message(value: object) -> None:
    for tree, answers in (
        ("drive: x\nretry: ${n}", FAILS),
        ("drive: x\nrepeat: ${n}", [ScriptedReply()]),
    ):
        stage = Stage(tree, head=TUNABLE, answers={"drive": answers})
        stage.tunables["n"] = value  # type: ignore[assignment]
        stage.tick()
        assert stage.outcome == "failed"
        assert "expected a whole number from 1 on" in stage.message


def test_computed_count_accepts_integral_float() -> None:
    stage = Stage("drive: x\nretry: ${n * 3 / 2}", head=TUNABLE, answers={"drive": FAILS})
    assert stage.tick(3) == "failed"
    assert len(stage.asked) == 3


def test_single_attempt_reports_failed_once() -> None:
    stage = Stage("say: x\ntimeout: 0 s\nretry: 1", answers={"say": LONG})
    assert stage.tick() == "failed"
    assert stage.reports("tree@retry")[-1][1].startswith("failed once (tree@retry")


def test_interrupted_retry_counts_from_zero() -> None:
    stage = Stage("drive: x\nretry: {attempts: 2, pause: 5 s}", answers={"drive": FAILS})
    stage.tick()
    stage.interrupt()
    assert {node.status.name for node in stage.root.iterate()} == {"INVALID"}
    assert stage.tick() == "running"
    assert len(stage.asked) == 2
    assert stage.after(5.0) == "failed"
    assert len(stage.asked) == 3


def test_cancel_during_pause_ends_run_immediately() -> None:
    stage = Stage("drive: x\nretry: {attempts: 9, pause: 1 h}", answers={"drive": FAILS})
    stage.tick()
    stage.run.cancel("enough")
    assert stage.outcome == "cancelled"


def test_repeat_pauses_only_between_rounds() -> None:
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


def test_repeat_fails_at_first_failure() -> None:
    stage = Stage(
        "drive: x\nrepeat: forever", answers={"drive": [ScriptedReply(), ScriptedReply(), *FAILS]}
    )
    assert stage.tick(2) == "running"
    assert stage.tick() == "failed"
    assert stage.message == "drive aborted: motor off"


def test_repeat_until_evaluates_after_success_and_after_pause() -> None:
    stage = Stage("say: x\nrepeat: {until: live.mood >= 4, pause: 1 s}")
    assert stage.tick(3, step_s=1.0) == "running"
    stage.set_mood(5.0)
    assert stage.tick() == "running"
    assert stage.after(1.0) == "succeeded"
    assert len(stage.said) == 3


def test_repeat_until_without_pause_evaluates_before_next_round() -> None:
    stage = Stage("say: x\nrepeat: {until: live.mood >= 4}")
    assert stage.tick() == "running"
    stage.set_mood(5.0)
    assert stage.tick() == "succeeded"
    assert len(stage.said) == 1


def test_repeat_until_true_condition_runs_once() -> None:
    stage = Stage("say: x\nrepeat: {times: 5, until: scene.age == 3}")
    assert stage.tick() == "succeeded"
    assert len(stage.said) == 1


def test_until_waits_for_missing_value_but_fails_undecided() -> None:
    stage = Stage("say: x\nrepeat: {until: live.age >= 4}", awarded=scene(mood=3))
    assert stage.tick(2) == "running"
    stage.set_live("age", 4.0)
    assert stage.tick() == "succeeded"
    stage = Stage("say: x\nrepeat: {until: 1 / live.mood > 0}", awarded=scene(mood=0))
    assert stage.tick() == "failed"
    assert "by zero" in stage.message


def test_repeat_with_until_succeeds_at_its_count() -> None:
    stage = Stage("say: x\nrepeat: {times: 3, until: live.mood > 4}")
    assert stage.tick(3) == "succeeded"
    assert len(stage.said) == 3


def test_until_reads_outputs_of_its_round() -> None:
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


def test_timeout_applies_to_each_retry_attempt() -> None:
    stage = Stage("say: x\ntimeout: 2 s\nretry: {attempts: 2, pause: 9 s}", answers={"say": LONG})
    stage.tick()
    assert stage.after(2.0) == "running"
    assert stage.environment.running() == []
    stage.after(9.0)
    assert stage.environment.running() == ["say"]
    assert stage.after(2.0) == "failed"
    assert len(stage.said) == 2


def test_retry_around_repeat_resets_round_count() -> None:
    stage = Stage(
        "drive: x\nrepeat: 2\nretry: 2",
        answers={"drive": [ScriptedReply(), FAILED, ScriptedReply()]},
    )
    assert stage.tick(3) == "running"
    assert stage.tick() == "succeeded"
    assert len(stage.asked) == 4
