# SPDX-License-Identifier: Apache-2.0
"""Every benchmark still works; its times are not tested."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import pytest

from bench import BENCHMARKS
from browser import installed_browser
from programs import output_of

HANG_S = 300.0


# tests/faults/test_floods.py runs the floods.
@pytest.mark.e2e
@pytest.mark.parametrize("name", [name for name in BENCHMARKS if name != "floods"])
def test_benchmark_runs(name: str, tmp_path: Path) -> None:
    if name == "studio":
        installed_browser()
    file = tmp_path / "figures.json"
    command = [sys.executable, "benchmarks/bench.py", name, "--short", "--json", str(file)]
    output_of(command, HANG_S, XDG_STATE_HOME=str(tmp_path / "state"))
    [rows] = [kept["rows"] for kept in json.loads(file.read_text()).values()]
    assert rows
    for row in rows:
        values = row["values"] + row["floor_values"]
        assert all(math.isfinite(value) and value >= 0 for value in values), row
        assert max(row["values"]) > 0, row
        assert row["goal"] is None or row["ratio"] is not None, row
