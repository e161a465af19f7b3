# SPDX-License-Identifier: Apache-2.0
"""Comparison of measurements of one run, and the tables of benchmarks."""

from __future__ import annotations

import importlib.util
import io
import json
from pathlib import Path
from random import Random
from typing import Any

import pytest
from click.testing import CliRunner
from rich.console import Console

import bench
import figures
from figures import BEGIN, END, as_json, markdown, put_into, table
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


def kept(*rows: Row, short: bool = False) -> dict[str, Any]:
    machine = {"cpu": "fast", "cores": "2", "system": "Linux", "python": "3.11", "load": "0"}
    return {
        "hops": {
            "what": "hops",
            "measured": "2026-11-21T20:00:00+00:00",
            "short": short,
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


def test_table_names_each_case_and_note_once() -> None:
    rows = [row(note="time goes [there]"), row(side="a peer", goal=1.0, note="time goes [there]")]
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(table("hops", rows))
    text = console.export_text()
    lines = [" ".join(line.split()) for line in text.splitlines() if "µs" in line]
    assert lines == [
        "ours 1) 3 µs 2 … 7 bare 2 µs 1.5 1.5 … 2 ≤ 1.5 met",
        "a peer 1) 3 µs 2 … 7 bare 2 µs 1.5 1.5 … 2 ≤ 1 missed",
    ]
    assert text.count("a hop") == 1
    assert text.count("time goes [there]") == 1


def test_markdown_table_escapes_bars_and_marks_missed_goals() -> None:
    text = markdown([row(case="a|b"), row(goal=1.0, note="DDS")])
    assert "| a\\|b | ours | 3 µs | 2 … 7 | bare 2 µs | 1.5 | 1.5 … 2 | ≤ 1.5 met |" in text
    assert (
        "| a hop | ours 1) | 3 µs | 2 … 7 | bare 2 µs | 1.5 | 1.5 … 2 | **≤ 1 missed** |" in text
    )
    assert text.endswith("\n1) DDS\n")


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (4e-8, "s", ("40 ns", "40 … 40")),
        (2.5e-3, "s", ("2.5 ms", "2.5 … 2.5")),
        (12.0, "s", ("12 s", "12 … 12")),
        (1234.4, "MiB", ("1,234 MiB", "1,234 … 1,234")),
    ],
)
def test_values_are_written_in_a_readable_unit(
    value: float, unit: str, shown: tuple[str, str]
) -> None:
    one = row(values=[value] * 3, unit=unit, floor="", floor_values=())
    assert figures.cells(one)[1:3] == shown


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


def test_meaningless_figures_are_not_written_to_page() -> None:
    with pytest.raises(ValueError, match="hops"):
        put_into(f"{BEGIN}{END}", kept(row(), short=True))
    with pytest.raises(ValueError, match="no place"):
        put_into(BEGIN, kept(row()))


def test_performance_page_has_place_for_figures() -> None:
    page = (ROOT / "docs" / "performance.md").read_text()
    assert put_into(page, kept(row())).count(END) == 1


def test_every_named_benchmark_exists_and_is_explained() -> None:
    page = (ROOT / "docs" / "performance.md").read_text()
    for name in bench.BENCHMARKS:
        assert importlib.util.find_spec(name) is not None, name
        assert f"`{name}`" in page, name


def test_unknown_benchmark_is_refused_with_existing_names() -> None:
    result = CliRunner().invoke(bench.main, ["tikcing"])
    assert result.exit_code == 2
    assert "ticking" in result.output


def test_figures_of_other_benchmarks_are_kept(tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    for name, found in (("runs", 1), ("ticking", 2), ("runs", 3)):
        bench._keep(file, name, {"rows": [found]})
    found = json.loads(file.read_text())
    assert found == {"ticking": {"rows": [2]}, "runs": {"rows": [3]}}
    assert list(found) == ["ticking", "runs"]


RAISES = """
    yield Row(case="c", side="s", values=[1.0])
    raise LookupError("no such floor")
"""
DIES = """
    yield Row(case="c", side="s", values=[1.0])
    time.sleep(0.2)
    os._exit(3)
"""
HANGS = """
    yield Row(case="c", side="s", values=[1.0])
    try:
        time.sleep(60)
    finally:
        Path(__file__).with_suffix(".ended").touch()
"""
GIVES_NOTHING = """
    yield from ()
"""


@pytest.mark.parametrize(
    ("body", "rows", "words"),
    [
        (RAISES, 1, "LookupError: no such floor"),
        (DIES, 1, "ended too early"),
        (HANGS, 1, "longer than 5 s"),
        (GIVES_NOTHING, 0, "no figures"),
    ],
    ids=["raises", "dies", "hangs", "gives nothing"],
)
def test_failing_benchmark_reports_reason_and_keeps_figures(
    body: str, rows: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = "import os, time\nfrom pathlib import Path\nfrom measuring import Row\n\n"
    file = tmp_path / "failing_benchmark.py"
    file.write_text(f"{head}def measure(effort):{body}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(bench, "LIMIT_S", 5.0)
    found, error = bench._run("failing_benchmark", True, 1)
    assert len(found) == rows
    assert words in error
    assert file.with_suffix(".ended").exists() is (body == HANGS)
