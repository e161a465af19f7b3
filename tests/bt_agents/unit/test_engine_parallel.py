# SPDX-License-Identifier: Apache-2.0
"""Parallel children: when they succeed together, and when they no longer can."""

from __future__ import annotations

import pytest

from bt_agents.engine.environment import GoalState
from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import TreeHarness

STATES = {"S": GoalState.SUCCEEDED, "F": GoalState.ABORTED}


def parallel(succeed_on: str, ends: str) -> TreeHarness:
    """Return a parallel of say, show and drive; ``F2`` means that one fails after 2 s."""
    tree = f"""
        parallel:
          succeed_on: {succeed_on}
          children: [say: x, show: y, drive: z]
    """
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
    found = [harness.tick(), *(harness.after(1.0) for _ in outcomes[1:])]
    assert "".join(one[0].upper() for one in found) == outcomes
    assert harness.environment.running() == []
    assert harness.asked == ["say", "show", "drive"]


def test_failed_parallel_names_child_and_missing_successes() -> None:
    harness = parallel("2", "F0 F1 S9")
    harness.tick()
    assert harness.after(1.0) == "failed"
    assert harness.reports("tree")[-1] == ("FAILURE", "2 had to succeed, at most 1 still can")
    assert harness.result.tip == "tree/1.show"
    assert harness.status("2.drive") == "INVALID"
