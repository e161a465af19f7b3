# SPDX-License-Identifier: Apache-2.0
"""Retry and repeat with pauses, limits and ends, tick by tick."""

from __future__ import annotations

import pytest

from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents_core.field_types import Plain
from tree_harness import FAILS, LONG, TreeHarness, scene, started

TUNABLE = "tunables: {n: {default: 2, min: 1, max: 9, description: d}}"
REST = "tunables: {rest: {default: 2 s, min: 0 s, max: 60 s, description: d}}"


def test_retry_pauses_between_attempts() -> None:
    #  t | drive | retry
    #  0 |   F   |   R     attempt 1
    #  1 |       |   R     pause
    #  2 |   F   |   R     attempt 2
    #  4 |   S   |   S     attempt 3
    harness = started(
        "drive: x\nretry: {attempts: 3, pause: 2 s}",
        answers={"drive": [*FAILS, *FAILS, ScriptedReply()]},
    )
    assert (harness.status("tree@retry"), harness.status("tree")) == ("RUNNING", "FAILURE")
    assert harness.run.tip == "tree@retry"
    assert (harness.after(1.9), len(harness.asked)) == ("running", 1)
    assert (harness.after(0.1), len(harness.asked)) == ("running", 2)
    assert (harness.after(2.0), len(harness.asked)) == ("succeeded", 3)


def test_retry_reports_its_attempt_number() -> None:
    harness = started(
        "drive: x\nretry: {attempts: 2, pause: 2 s}",
        answers={"drive": [*FAILS, ScriptedReply(after_s=1.0)]},
    )
    harness.outcomes(2, 1)
    assert harness.reports("tree@retry") == [
        ("RUNNING", "attempt 2 of 2, after a pause of 2 s"),
        ("RUNNING", "attempt 2 of 2"),
        ("SUCCESS", ""),
    ]


def test_running_pause_follows_tuned_duration() -> None:
    harness = started(
        "drive: x\nretry: {attempts: 5, pause: '${rest}'}", head=REST, answers={"drive": FAILS}
    )
    harness.after(1.0)
    harness.tunables["rest"] = 1.0
    harness.tick()
    assert len(harness.asked) == 2
    harness.tunables["rest"] = -3.0
    assert harness.tick() == "failed"
    assert "expected a time such as '5 s'" in harness.message
    assert "(tree@retry, a.yaml:" in harness.message


def test_tuning_an_elapsed_pause_does_not_delay_attempt() -> None:
    harness = started(
        "drive: x\nretry: {attempts: 2, pause: '${rest}'}",
        head=REST,
        answers={"drive": [*FAILS, ScriptedReply(after_s=2.0)]},
    )
    harness.after(2.0)
    harness.tunables["rest"] = 60.0
    assert harness.run.tip == "tree"
    assert harness.after(2.0) == "succeeded"


def test_attempt_limit_is_evaluated_after_each_failure() -> None:
    harness = started("drive: x\nretry: ${n}", head=TUNABLE, answers={"drive": FAILS})
    harness.tunables["n"] = 4
    assert harness.tick(2) == "running"
    harness.tunables["n"] = 1
    assert (harness.tick(), len(harness.asked)) == ("failed", 4)
    assert "motor off" in harness.message


@pytest.mark.parametrize("value", [0, -1, 1.5, float("nan"), float("inf"), True, "two", None])
@pytest.mark.parametrize("tree", ["drive: x\nretry: ${n}", "say: x\nrepeat: ${n}"])
def test_invalid_count_fails_with_message(tree: str, value: Plain) -> None:
    harness = TreeHarness(tree, head=TUNABLE, answers={"drive": FAILS})
    harness.tunables["n"] = value
    assert harness.tick() == "failed"
    assert "expected a whole number from 1 on" in harness.message


def test_computed_count_accepts_integral_float() -> None:
    harness = TreeHarness("drive: x\nretry: ${n * 3 / 2}", head=TUNABLE, answers={"drive": FAILS})
    assert harness.tick(3) == "failed"
    assert len(harness.asked) == 3


def test_single_attempt_reports_failed_once() -> None:
    harness = TreeHarness("say: x\ntimeout: 0 s\nretry: 1", answers={"say": LONG})
    assert harness.tick() == "failed"
    assert harness.reports("tree@retry")[-1][1].startswith("failed once (tree@retry")


def test_interrupted_retry_counts_from_zero() -> None:
    harness = started("drive: x\nretry: {attempts: 2, pause: 5 s}", answers={"drive": FAILS})
    harness.interrupt()
    assert {node.status.name for node in harness.root.iterate()} == {"INVALID"}
    assert harness.outcomes(0, 5) == "RF"
    assert len(harness.asked) == 3


def test_until_is_evaluated_after_success_and_after_pause() -> None:
    harness = TreeHarness("say: x\nrepeat: {until: live.mood >= 4, pause: 1 s}")
    assert harness.tick(3, step_s=1.0) == "running"
    harness.set_mood(5.0)
    assert harness.outcomes(0, 1) == "RS"
    assert len(harness.said) == 3


@pytest.mark.parametrize(("until", "rounds"), [("scene.age == 3", 1), ("live.mood > 4", 3)])
def test_repeat_ends_at_its_condition_or_count(until: str, rounds: int) -> None:
    harness = TreeHarness(f"say: x\nrepeat: {{times: 3, until: {until}}}")
    assert harness.tick(rounds) == "succeeded"
    assert len(harness.said) == rounds


def test_until_waits_for_missing_value() -> None:
    harness = TreeHarness("say: x\nrepeat: {until: live.age >= 4}", awarded=scene(mood=3))
    assert harness.tick(2) == "running"
    harness.set_live("age", 4.0)
    assert harness.tick() == "succeeded"


def test_until_reads_outputs_of_its_round() -> None:
    replies = [ScriptedReply(result={"answer": answer}) for answer in ("no", "yes")]
    harness = TreeHarness(
        "ask: Ready?\nrepeat: {until: answer == 'yes'}", answers={"ask": replies}
    )
    assert harness.outcomes(0, 0) == "RS"
