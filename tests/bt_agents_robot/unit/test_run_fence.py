# SPDX-License-Identifier: Apache-2.0
"""Run fence: which runs have ended for the robot."""

from __future__ import annotations

import pytest

from bt_agents_core.run_key import RunKey
from bt_agents_robot.run_fence import MOST_RUNS, RunFence

NOBODY = RunKey(epoch="")


def run(round_: int, agent: str = "leo", epoch: str = "e1") -> RunKey:
    return RunKey(epoch=epoch, round=round_, agent=agent)


def fence(*named: RunKey) -> RunFence:
    subject = RunFence()
    for one in named:
        subject.on_market(one)
    return subject


CASES = {
    "no market was heard": ([], run(3), False),
    "under way": ([run(3)], run(3), False),
    "its award is not known yet": ([run(3)], run(4), False),
    "of an earlier round": ([run(3)], run(2), True),
    "the round went to another": ([run(3, "leo"), run(3, "mira")], run(3, "leo"), True),
    "the round goes to another": ([run(3, "leo")], run(3, "mira"), False),
    "nobody has the robot any more": ([run(3, "leo"), run(3, "")], run(3, "leo"), True),
    "the market is at a later round": ([run(3, "leo"), run(4, "mira")], run(3, "leo"), True),
    "awarded once more": ([run(3), run(3, "mira"), run(3)], run(3), False),
}


@pytest.mark.parametrize(("named", "goal", "over"), CASES.values(), ids=CASES)
def test_run_is_over_once_market_moves_on(named, goal, over):
    assert fence(*named).is_over(goal) is over


def test_later_run_supersedes_earlier_ones():
    subject = fence(run(3), run(4))
    assert subject.is_superseded(run(5), by=run(6))
    assert not subject.is_superseded(run(5), by=run(5))
    assert not subject.is_superseded(run(6), by=run(5))
    assert not subject.is_superseded(run(5), by=run(6, epoch="e2"))
    assert subject.is_superseded(run(3), by=NOBODY)
    assert not subject.is_superseded(NOBODY, by=run(6))


def test_goal_without_run_is_never_over():
    assert not fence(run(3), run(4)).is_over(NOBODY)


def test_run_of_unknown_market_is_admitted():
    assert not fence(run(3)).is_over(run(1, epoch="of a host without a market"))


def test_last_run_may_clean_up_until_next_award():
    subject = fence(run(3), run(0, "", epoch="e2"))
    assert not subject.is_over(run(3))
    subject.on_market(run(1, "mira", epoch="e2"))
    assert subject.is_over(run(3))


def test_only_latest_markets_and_runs_are_remembered():
    subject = fence(*(run(1, str(n)) for n in range(2 * MOST_RUNS)))
    assert not subject.is_over(run(1, "0"))
    assert subject.is_over(run(1, str(2 * MOST_RUNS - 2)))
    for number in range(2 * MOST_RUNS):
        subject.on_market(run(1, epoch=f"m{number}"))
    assert not subject.is_over(run(1, epoch="m0"))
    assert subject.is_over(run(1, epoch=f"m{2 * MOST_RUNS - 2}"))
