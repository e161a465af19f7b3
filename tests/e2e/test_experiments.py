# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments in real processes: each profile equals its closed form."""

from __future__ import annotations

import csv
from collections import defaultdict
from pathlib import Path

import pytest

from programs import Ask

pytestmark = pytest.mark.e2e

TARGETS = {"agent_1": 1.0, "agent_3": 3.0, "agent_5": 5.0}


def test_experiment_3_matches_closed_form_each_round(ask: Ask, tmp_path: Path) -> None:
    table = tmp_path / "rounds.csv"
    said = " ".join(
        ask("experiment", "run", "3", "--ros", "--rounds", "60", "--out", str(table)).split()
    )
    assert "60 rounds through ROS against 60 without it: equal" in said
    assert "not equal" not in said
    with table.open() as file:
        found = list(csv.DictReader(file))
    scenes = [float(row["value_age"]) for row in found if row["row"] == "round"]
    rows = [row for row in found if row["row"] == "feedback"]
    assert len(rows) == len(scenes) == 60
    won: dict[str, int] = defaultdict(int)
    for row in rows:
        agent = row["agent"]
        target = TARGETS[agent]
        for name in ("age", "profession", "emotion"):
            for column, cycles in (("before", won[agent]), ("after", won[agent] + 1)):
                expected = target + (2.5 - target) * 0.8**cycles
                assert float(row[f"{column}_{name}"]) == pytest.approx(expected, abs=1e-12)
        won[agent] += 1
    profiles = dict.fromkeys(TARGETS, 2.5)
    for scene, row in zip(scenes, rows, strict=True):
        nearest = min(abs(profile - scene) for profile in profiles.values())
        assert abs(profiles[row["agent"]] - scene) == pytest.approx(nearest, abs=1e-9)
        profiles[row["agent"]] = float(row["after_age"])


@pytest.mark.parametrize(
    ("words", "rounds", "strategies"),
    [
        (("1",), "40", 1),
        (("2", "--seed", "4"), "20", 3),
        (("recommended", "--strategy", "bounded_ucb"), "40", 1),
    ],
    ids=["1", "2", "recommended"],
)
def test_experiments_match_with_and_without_ros(
    ask: Ask, words: tuple[str, ...], rounds: str, strategies: int
) -> None:
    said = " ".join(ask("experiment", "run", *words, "--ros", "--rounds", rounds).split())
    assert (
        said.count(f"{rounds} rounds through ROS against {rounds} without it: equal") == strategies
    )
    assert "not equal" not in said
