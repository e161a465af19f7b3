# SPDX-License-Identifier: Apache-2.0
"""Parallel children: when they have succeeded together, and when that cannot happen any more."""

from __future__ import annotations

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import Stage


def ends(after_s: float, *, well: bool = True) -> list[ScriptedReply]:
    state = GoalState.SUCCEEDED if well else GoalState.ABORTED
    return [ScriptedReply(after_s=after_s, state=state)]


def tree(succeed_on: str) -> str:
    return f"""
        parallel:
          succeed_on: {succeed_on}
          children:
            - say: x
              name: talk
            - show: y
              name: film
            - drive: z
              name: way
        """


def test_parallel_succeeds_at_required_count() -> None:
    #  t | say | show | drive     | parallel
    #  0 |  R  |  R   |  R        |   R
    #  1 |  S  |  R   |  R        |   R
    #  2 |     |  S   | cancelled |   S
    stage = Stage(tree("2"), answers={"say": ends(1.0), "show": ends(2.0), "drive": ends(9.0)})
    assert stage.tick() == "running"
    assert stage.after(1.0) == "running"
    assert stage.after(1.0) == "succeeded"
    assert stage.environment.running() == []
    assert stage.status("2.way") == "INVALID"
    assert stage.asked == ["say", "show", "drive"]


def test_parallel_survives_failures_while_count_is_reachable() -> None:
    #  t | say | show | drive | parallel
    #  1 |  F  |  R   |  R    |   R
    #  2 |     |  S   |  R    |   R
    #  3 |     |      |  S    |   S
    stage = Stage(
        tree("2"), answers={"say": ends(1.0, well=False), "show": ends(2.0), "drive": ends(3.0)}
    )
    assert stage.tick(3, step_s=1.0) == "running"
    assert stage.after(1.0) == "succeeded"
    assert stage.asked == ["say", "show", "drive"]


def test_parallel_fails_once_count_is_unreachable() -> None:
    stage = Stage(
        tree("2"),
        answers={"say": ends(1.0, well=False), "show": ends(2.0, well=False), "drive": ends(9.0)},
    )
    assert stage.tick(2, step_s=1.0) == "running"
    assert stage.after(1.0) == "failed"
    assert stage.environment.running() == []
    assert ("FAILURE", "2 had to succeed, at most 1 still can") in stage.reports("tree")


def test_parallel_one_succeeds_after_other_failures() -> None:
    answers = {"say": ends(1.0, well=False), "show": ends(2.0, well=False), "drive": ends(3.0)}
    stage = Stage(tree("one"), answers=answers)
    assert stage.tick(3, step_s=1.0) == "running"
    assert stage.after(1.0) == "succeeded"
    answers["drive"] = ends(3.0, well=False)
    stage = Stage(tree("one"), answers=answers)
    assert stage.tick(3, step_s=1.0) == "running"
    assert stage.after(1.0) == "failed"


def test_parallel_all_fails_at_first_failure() -> None:
    stage = Stage(
        tree("all"), answers={"say": ends(1.0), "show": ends(2.0, well=False), "drive": ends(9.0)}
    )
    assert stage.tick(2, step_s=1.0) == "running"
    assert stage.after(1.0) == "failed"
    assert stage.environment.running() == []
    assert stage.run.result is not None
    assert stage.run.result.tip == "tree/1.film"


def test_named_children_decide_parallel_and_halt_others() -> None:
    stage = Stage(
        tree("[talk, way]"), answers={"say": ends(1.0), "show": ends(99.0), "drive": ends(2.0)}
    )
    assert stage.tick(2, step_s=1.0) == "running"
    assert stage.after(1.0) == "succeeded"
    assert stage.environment.running() == []


@pytest.mark.parametrize("failing", ["say", "show", "drive"])
def test_any_failure_fails_parallel_with_named_children(failing: str) -> None:
    answers = {"say": ends(9.0), "show": ends(9.0), "drive": ends(9.0)}
    answers[failing] = ends(1.0, well=False)
    stage = Stage(tree("[talk]"), answers=answers)
    assert stage.tick() == "running"
    assert stage.after(1.0) == "failed"
    assert stage.environment.running() == []


def test_parallel_does_not_restart_finished_child() -> None:
    stage = Stage(tree("all"), answers={"say": ends(0.0), "show": ends(0.0), "drive": ends(5.0)})
    assert stage.tick(6, step_s=1.0) == "succeeded"
    assert stage.asked == ["say", "show", "drive"]


def test_interrupted_parallel_halts_children_and_starts_afresh() -> None:
    stage = Stage(tree("2"), answers={"say": ends(1.0), "show": ends(9.0), "drive": ends(9.0)})
    stage.tick(2, step_s=1.0)
    stage.interrupt()
    assert stage.environment.running() == []
    assert {node.status.name for node in stage.root.iterate()} == {"INVALID"}
    stage.tick()
    assert stage.asked == ["say", "show", "drive"] * 2
    assert stage.after(1.0) == "running"
    assert stage.after(8.0) == "succeeded"


def test_instantly_succeeding_child_counts_in_first_tick() -> None:
    stage = Stage(tree("one"), answers={"say": ends(0.0), "show": ends(9.0), "drive": ends(9.0)})
    assert stage.tick() == "succeeded"
    assert stage.environment.running() == []


def test_repeated_parallel_restarts_every_child() -> None:
    stage = Stage("parallel:\n  - say: x\n  - show: y\nrepeat: 2")
    assert stage.tick() == "running"
    assert stage.tick() == "succeeded"
    assert stage.asked == ["say", "show"] * 2
