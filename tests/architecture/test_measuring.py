# SPDX-License-Identifier: Apache-2.0
"""Comparison of measurements of one run, and the tables of benchmarks."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from random import Random
from typing import Any

import pytest

import bench
from figures import BEGIN, END, as_json, put_into
from measuring import Effort, Row, in_turn

ROOT = Path(__file__).parents[2]


def row(**changes: Any) -> Row:
    values: dict[str, Any] = {
        "case": "a hop",
        "side": "ours",
        "values": [2e-6, 3e-6, 7e-6],
        "floor": "bare",
        "floor_values": [1e-6, 2e-6, 4e-6],
        "goal": 1.5,
    }
    return Row(**values | changes)


def kept(*rows: Row) -> dict[str, Any]:
    machine = {"cpu": "fast", "cores": "2", "system": "Linux", "python": "3.11", "load": "0"}
    return {
        "hops": {
            "what": "hops",
            "measured": "2026-11-21T20:00:00+00:00",
            "short": False,
            "machine": machine,
            "rows": json.loads(json.dumps([as_json(one) for one in rows])),
        }
    }


def effort(**changes: Any) -> Effort:
    return Effort(random=Random(1), **changes)


def test_ratio_uses_medians_and_spread_uses_repetitions() -> None:
    assert row().ratio == pytest.approx(1.5)
    assert row().ratios == pytest.approx([2.0, 1.5, 1.75])


@pytest.mark.parametrize(
    ("changes", "met"),
    [
        ({"goal": 1.5}, True),
        ({"goal": 1.4}, False),
        ({"goal": 1.4, "at_least": True}, True),
        ({"goal": 1.6, "at_least": True}, False),
        ({"goal": None}, None),
        ({"floor": "", "floor_values": ()}, None),
        ({"floor_values": [0.0, 0.0, 4e-6]}, None),
    ],
)
def test_goal_is_met_from_one_side(changes: dict[str, Any], met: bool | None) -> None:
    assert row(**changes).is_met is met


@pytest.mark.parametrize("changes", [{"values": []}, {"floor_values": [1e-6]}])
def test_row_with_missing_floor_values_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="lacks values"):
        row(**changes)


def test_variants_are_measured_alternately_in_changing_order() -> None:
    called: list[str] = []

    def way(name: str) -> Any:
        return lambda: float(called.append(name) or len(called))

    found = in_turn({name: way(name) for name in "abc"}, effort(repetitions=20))
    turns = [tuple(called[i : i + 3]) for i in range(0, 60, 3)]
    assert all(sorted(turn) == ["a", "b", "c"] for turn in turns)
    assert len(set(turns)) > 3
    assert sorted(value for values in found.values() for value in values) == list(range(1, 61))
    assert all(called[int(value) - 1] == name for name in "abc" for value in found[name])


def test_new_figures_replace_only_old_figures_on_page() -> None:
    page = f"before\n{BEGIN}\nformer\n{END}\nafter\n"
    new = put_into(page, kept(row(), row(goal=1.0, note="DDS")))
    assert new.startswith("before\n")
    assert new.endswith("after\n")
    assert "former" not in new
    assert "1 of 2 goals met; 2026-11-21, fast, 2 cores" in new
    assert "**1 of 2 goals are met.**" in new
    assert "| 3 µs | 2 … 7 | bare 2 µs | 1.5 | 1.5 … 2 | **≤ 1 missed** |" in new
    assert "1) DDS" in new
    assert put_into(new, kept(row(), row(goal=1.0, note="DDS"))) == new


def test_every_named_benchmark_exists_and_is_explained() -> None:
    page = (ROOT / "docs" / "performance.md").read_text()
    for name in bench.BENCHMARKS:
        assert importlib.util.find_spec(name) is not None, name
        assert f"`{name}`" in page, name
