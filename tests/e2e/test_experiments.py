# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments through real processes, each profile against its closed form."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.e2e

TARGETS = {"agent_1": 1.0, "agent_3": 3.0, "agent_5": 5.0}


def test_experiment_3_follows_the_closed_form_round_by_round(
    ask: Callable[..., str], tmp_path: Path
) -> None:
    table = tmp_path / "rounds.csv"
    said = ask("experiment", "3", "--csv", str(table))
    assert "equal" in said
    assert "not equal" not in said
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 150
    won: dict[str, int] = defaultdict(int)
    for row in rows:
        agent = row["winner"]
        target = TARGETS[agent]
        for name in ("age", "profession", "emotion"):
            for column, cycles in (("before", won[agent]), ("after", won[agent] + 1)):
                expected = target + (2.5 - target) * 0.8**cycles
                assert float(row[f"{column}_{name}"]) == pytest.approx(expected, abs=1e-9)
        won[agent] += 1
    profiles = dict.fromkeys(TARGETS, 2.5)
    for row in rows:
        scene = float(row["scene_age"])
        nearest = min(abs(profile - scene) for profile in profiles.values())
        assert abs(profiles[row["winner"]] - scene) == pytest.approx(nearest, abs=1e-9)
        profiles[row["winner"]] = float(row["after_age"])


def test_experiment_1_reaches_its_target_in_100_cycles(ask: Callable[..., str]) -> None:
    said = ask("experiment", "1")
    assert "5.0000, 4.0000, 1.0000" in said
    assert "not equal" not in said
