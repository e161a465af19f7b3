# SPDX-License-Identifier: Apache-2.0
"""The paper's claims and the verdicts on them, and figures: reproducible, with no text cut."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from bt_agents_core.trees_folder import find_sweep
from bt_agents_lab.experiments import claims, drawing, paper_figures, sweep_figures
from bt_agents_lab.experiments.core import through_core
from bt_agents_lab.experiments.replicas import opened, replicas, streams_of, with_seed, world_of
from bt_agents_lab.experiments.sweep import sweep
from bt_agents_lab.experiments.sweep_reader import read_sweep
from bt_agents_lab.experiments.verdicts import Claim, as_markdown, judged, percent
from bt_agents_tools.cli.main import bt_agents
from checkout import ROOT

EXPERIMENTS = ROOT / "experiments"
CLAIM = Claim(name="n", section="1", quote="q", criterion="c")


def paper(name: str) -> claims.Paper:
    folder, spec = opened(EXPERIMENTS / name)
    return claims.Paper(folder=folder, spec=spec)


@pytest.mark.parametrize("name", ["2-aggressive", "2-moderate", "3"])
def test_batched_runs_equal_experiments_with_their_seeds(name):
    folder, spec = opened(EXPERIMENTS / name)
    spec = spec.shortened(25)
    world = world_of(folder, spec)
    seeds = [spec.seed, 5]
    many = replicas(world, spec, seeds)
    for row, seed in enumerate(seeds):
        records = through_core(folder, with_seed(spec, seed))
        winners = [world.agents[index] for index in many.course.awarded[row]]
        assert winners == [record.winner for record in records]
        for index, record in enumerate(records):
            after = many.course.profiles[row, index, many.course.awarded[row, index]]
            assert tuple(after.tolist()) == record.after


def test_every_third_wrong_feedback_shifts_the_mean():
    folder, spec = opened(EXPERIMENTS / "2-aggressive")
    world = world_of(folder, spec)
    assert (streams_of(world, spec, [2]).error_draw[0, :6, 0] == [1, 1, 0, 1, 1, 0]).all()
    late = replicas(world, spec, [2]).course.profiles[0, -99:, 0].mean(axis=0)
    assert late == pytest.approx([5.0, 4 + 1 / 3, 2 + 1 / 3], abs=1e-3)


@pytest.mark.parametrize(
    ("held", "words"),
    [
        ([True], "holds"),
        ([False], "fails"),
        ([True] * 20, "holds (20 of 20 runs, 95 % interval 83.9 % to 100 %)"),
        ([False] * 20, "fails (0 of 20 runs, 95 % interval 0 % to 16.1 %)"),
        (
            [True] * 15 + [False] * 5,
            "holds in 75 % of runs (15 of 20 runs, 95 % interval 53.1 % to 88.8 %)",
        ),
    ],
)
def test_verdict_states_number_of_runs_claim_holds_in(held, words):
    verdict = judged(CLAIM, held, "found", "because")
    assert verdict.text == words
    assert (verdict.reason == "") == all(held)


def test_share_below_all_is_not_rounded_up():
    shares = ", ".join(map(percent, (0.0, 0.5, 0.99996, 0.0004, 1.0)))
    assert shares == "0 %, 50 %, 99.996 %, 0.04 %, 100 %"


def test_plot_command_reproduces_figures_and_judges_all_claims(tmp_path, monkeypatch):
    # Small pictures are sufficient, and cheaper.
    monkeypatch.setattr(drawing, "_PNG_DPI", 30)
    folders = (tmp_path / "one", tmp_path / "two")
    for folder, what in zip(folders, ("all", "3"), strict=True):
        words = ["experiment", "plot", what, "--seeds", "3", "--output", str(folder)]
        result = CliRunner().invoke(bt_agents, words, catch_exceptions=False)
        assert result.exit_code == 0, result.output
    names = {path.name for path in folders[0].iterdir()}
    figures = {f"figure-{n}.{kind}" for n in range(5, 10) for kind in ("svg", "png")}
    assert names == figures | {"verdicts.md", "verdicts.json"}
    # The last figure has bands, random elements, marks and legends.
    for name in ("figure-9.svg", "figure-9.png"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name
    verdicts = json.loads((folders[0] / "verdicts.json").read_text())
    words = {verdict["claim"]["name"]: verdict["verdict"] for verdict in verdicts}
    assert len(words) == 11
    assert words["Convergence"] == words["Speed follows the rate"] == "holds"
    assert words["A moderate rate stays robust under noise"].startswith("fails")
    assert all(verdict["reason"] or verdict["held"] == verdict["runs"] for verdict in verdicts)
    assert json.loads((folders[1] / "verdicts-3.json").read_text()) == verdicts[-2:]


def test_unreached_distance_is_reported_as_never_reached():
    one = paper("1")
    convergence, speed = claims.first(replace(one, spec=one.spec.shortened(5)))
    assert convergence.text == speed.text == "fails"
    assert "after 5 cycles at rate 0.2, never below 0.05;" in convergence.found
    assert speed.found == "never at rate 0.05, never at rate 0.2, never at rate 0.5"


def test_documented_figures_are_small():
    figures = sorted((ROOT / "docs" / "figures").glob("*.svg"))
    assert len(figures) >= 9
    assert all(figure.stat().st_size < 200_000 for figure in figures)


def test_verdict_links_its_figures():
    claim = replace(CLAIM, figures=(6, 8))
    text = as_markdown([judged(claim, [True], "f")])
    assert "- Shown by: [figure 6](figure-6.svg), [figure 8](figure-8.svg)\n" in text


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


def test_paper_figures_cut_no_label(saved: dict[str, bool], tmp_path: Path) -> None:
    three = paper("3")
    paper_figures.first(tmp_path, paper("1"))
    paper_figures.second(tmp_path, {arm: paper(f"2-{arm}") for arm in claims.RATES}, range(3))
    paper_figures.third(tmp_path, claims.played_third(three, range(3)), three.spec.rounds)
    assert {f"figure-{number}.png" for number in range(5, 10)} <= saved.keys()


def test_sweep_figures_cut_no_label(saved: dict[str, bool], tmp_path: Path) -> None:
    spec = replace(read_sweep(find_sweep("told")), runs=2, rounds=5)
    sweep_figures.write(tmp_path, spec, sweep(spec, 1, lambda done, total: None))
    assert {"curves.png", "robustness.png"} <= saved.keys()
