# SPDX-License-Identifier: Apache-2.0
"""Parallel children: when they succeed together, and when they no longer can."""

from __future__ import annotations

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import TreeHarness


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
    harness = TreeHarness(
        tree("2"), answers={"say": ends(1.0), "show": ends(2.0), "drive": ends(9.0)}
    )
    assert harness.tick() == "running"
    assert harness.after(1.0) == "running"
    assert harness.after(1.0) == "succeeded"
    assert harness.environment.running() == []
    assert harness.status("2.way") == "INVALID"
    assert harness.asked == ["say", "show", "drive"]


def test_parallel_survives_failures_while_count_is_reachable() -> None:
    #  t | say | show | drive | parallel
    #  1 |  F  |  R   |  R    |   R
    #  2 |     |  S   |  R    |   R
    #  3 |     |      |  S    |   S
    harness = TreeHarness(
        tree("2"), answers={"say": ends(1.0, well=False), "show": ends(2.0), "drive": ends(3.0)}
    )
    assert harness.tick(3, step_s=1.0) == "running"
    assert harness.after(1.0) == "succeeded"
    assert harness.asked == ["say", "show", "drive"]


def test_parallel_fails_once_count_is_unreachable() -> None:
    harness = TreeHarness(
        tree("2"),
        answers={"say": ends(1.0, well=False), "show": ends(2.0, well=False), "drive": ends(9.0)},
    )
    assert harness.tick(2, step_s=1.0) == "running"
    assert harness.after(1.0) == "failed"
    assert harness.environment.running() == []
    assert ("FAILURE", "2 had to succeed, at most 1 still can") in harness.reports("tree")


def test_parallel_one_succeeds_after_other_failures() -> None:
    answers = {"say": ends(1.0, well=False), "show": ends(2.0, well=False), "drive": ends(3.0)}
    harness = TreeHarness(tree("one"), answers=answers)
    assert harness.tick(3, step_s=1.0) == "running"
    assert harness.after(1.0) == "succeeded"
    answers["drive"] = ends(3.0, well=False)
    harness = TreeHarness(tree("one"), answers=answers)
    assert harness.tick(3, step_s=1.0) == "running"
    assert harness.after(1.0) == "failed"


def test_parallel_all_fails_at_first_failure() -> None:
    harness = TreeHarness(
        tree("all"), answers={"say": ends(1.0), "show": ends(2.0, well=False), "drive": ends(9.0)}
    )
    assert harness.tick(2, step_s=1.0) == "running"
    assert harness.after(1.0) == "failed"
    assert harness.environment.running() == []
    assert harness.result.tip == "tree/1.film"


def test_instantly_succeeding_child_counts_in_first_tick() -> None:
    harness = TreeHarness(
        tree("one"), answers={"say": ends(0.0), "show": ends(9.0), "drive": ends(9.0)}
    )
    assert harness.tick() == "succeeded"
    assert harness.environment.running() == []
