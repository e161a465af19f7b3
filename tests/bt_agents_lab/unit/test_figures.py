# SPDX-License-Identifier: Apache-2.0
"""Figures: no text is cut at an edge."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from bt_agents_core.trees_folder import find_sweep
from bt_agents_lab.experiments import paper_figures, sweep_figures
from bt_agents_lab.experiments.claims import RATES, Paper, played_third
from bt_agents_lab.experiments.replicas import opened
from bt_agents_lab.experiments.sweep import sweep
from bt_agents_lab.experiments.sweep_reader import read_sweep
from checkout import ROOT

SEEDS = range(3)


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, bool]]:
    """Saved pictures, each with whether something is cut."""
    found: dict[str, bool] = {}

    def checked(figure: Figure, file: Path, **_: Any) -> None:
        if file.suffix == ".png":
            shown, room = figure.get_tightbbox(), figure.bbox_inches
            found[file.name] = (
                min(shown.x0, shown.y0) < 0.0 or shown.x1 > room.x1 or shown.y1 > room.y1
            )

    monkeypatch.setattr(Figure, "savefig", checked)
    yield found
    assert found
    assert not [file for file, is_cut in found.items() if is_cut]


def paper(name: str) -> Paper:
    folder, spec = opened(ROOT / "experiments" / name)
    return Paper(folder=folder, spec=spec)


def test_paper_figures_cut_no_label(saved: dict[str, bool], tmp_path: Path) -> None:
    three = paper("3")
    paper_figures.first(tmp_path, paper("1"))
    paper_figures.second(tmp_path, {arm: paper(f"2-{arm}") for arm in RATES}, SEEDS)
    paper_figures.third(tmp_path, played_third(three, SEEDS), three.spec.rounds)
    assert {f"figure-{number}.png" for number in range(5, 10)} <= saved.keys()


def test_sweep_figures_cut_no_label(saved: dict[str, bool], tmp_path: Path) -> None:
    spec = replace(read_sweep(find_sweep("told")), runs=2, rounds=5)
    sweep_figures.write(tmp_path, spec, sweep(spec, 1, lambda done, total: None))
    assert {"curves.png", "robustness.png"} <= saved.keys()
