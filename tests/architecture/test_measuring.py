# SPDX-License-Identifier: Apache-2.0
"""Comparison of measurements of one run."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

import bench
from measuring import Row

ROOT = Path(__file__).parents[2]


def test_ratio_uses_medians_and_spread_uses_repetitions() -> None:
    row = Row(
        case="a hop", values=[2.0, 3.0, 7.0], floor="bare", floor_values=[1.0, 2.0, 4.0], goal=1.5
    )
    assert row.ratio == pytest.approx(1.5)
    assert row.ratios == pytest.approx([2.0, 1.5, 1.75])
    assert row.is_met


def test_every_named_benchmark_exists_and_is_explained() -> None:
    page = (ROOT / "docs" / "performance.md").read_text()
    for name in bench.BENCHMARKS:
        assert importlib.util.find_spec(name) is not None, name
        assert f"`{name}`" in page, name
