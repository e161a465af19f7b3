# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments in real processes: equal to those without ROS, and to the formula."""

from __future__ import annotations

import pytest

from programs import Ask

pytestmark = pytest.mark.e2e


@pytest.mark.parametrize(
    ("words", "rounds", "strategies"),
    [
        (("1",), "40", 1),
        (("2", "--seed", "4"), "20", 3),
        (("3",), "60", 1),
        (("recommended", "--strategy", "bounded_ucb"), "40", 1),
    ],
    ids=["1", "2", "3", "recommended"],
)
def test_experiments_match_with_and_without_ros(
    ask: Ask, words: tuple[str, ...], rounds: str, strategies: int
) -> None:
    said = " ".join(ask("experiment", "run", *words, "--ros", "--rounds", rounds).split())
    assert (
        said.count(f"{rounds} rounds through ROS against {rounds} without it: equal") == strategies
    )
    assert "not equal" not in said
