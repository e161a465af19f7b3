# SPDX-License-Identifier: Apache-2.0
"""Sweeps: located errors, equal results for any number of processes, output files."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.feedback import LearningRule, Update
from bt_agents_core.trees_folder import find_sweep
from bt_agents_lab.experiments import drawing
from bt_agents_lab.experiments import sweep as sweeping
from bt_agents_lab.experiments.measures import converged, of_runs, summary
from bt_agents_lab.experiments.random_streams import draw
from bt_agents_lab.experiments.simulated_world import Arm
from bt_agents_lab.experiments.simulation import simulate
from bt_agents_lab.experiments.sweep import sweep
from bt_agents_lab.experiments.sweep_reader import read_sweep
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.tools.templates.first_files import new_agent
from bt_agents_language.yaml.source import Source
from bt_agents_tools.cli.main import bt_agents
from checkout import ROOT
from marketplace_node.settings import Settings

SWEEPS = ROOT / "experiments" / "sweeps"
TEXT = """\
format: 1
experiment: EXPERIMENTS/persons
runs: 6
rounds: 30
seed: 7
wrong: {shares: [0, 0.4]}
person: {seconds: 8, hold: 1 s}
strategies:
  - {name: manhattan, tie_break: random}
  - {name: thompson, sigma: 0.3}
updates:
  - plain
  - {name: median, window: 3}
"""
CHANGE = """\
arrivals: {swift_assistant: 9}
change: {round: 11, each: {calm_helper: {age: 1, familiarity: 1, mood: 2}}}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A small sweep."""
    path = tmp_path / "small.yaml"
    path.write_text(TEXT.replace("EXPERIMENTS", str(ROOT / "experiments")))
    return path


@pytest.fixture
def changing(file: Path) -> Path:
    """A small sweep of a world that changes."""
    file.write_text(file.read_text() + CHANGE)
    return file


@pytest.mark.parametrize("path", sorted(SWEEPS.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_sweeps_report_seeds_not_tuned_on(path):
    spec = read_sweep(path)
    assert spec.runs >= 50
    assert spec.rounds >= 300
    assert spec.seed >= 10_000
    assert Settings().strategy in {one.strategy for one in spec.selections}
    assert Update.HUBER in {learning.update for learning in spec.learnings}


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("name: thompson, sigma", "name: thomson, sigma", "10:12", "thompson"),
        ("sigma: 0.3", "c: 2", "10:22", "no option 'c'"),
        ("sigma: 0.3", "sigma: 99", "10:29", "99"),
        ("tie_break: random", "tie_break: dice", "9:34", "random"),
        ("0.4]", "1.4]", "6:21", "1.4"),
        ("hold: 1 s", "hold: 1.5 s", "7:28", "whole seconds"),
        ("seconds: 8", "second: 8", "7:10", "seconds"),
        ("swift_assistant: 9", "swift: 9", "14:12", "swift_assistant"),
        ("swift_assistant: 9", "swift_assistant: 1", "14:29", "2"),
        ("round: 11", "round: 1", "15:17", "2"),
        ("mood: 2}", "mood: 9}", "15:72", "9"),
        ("{calm_helper:", "{helper:", "15:28", "calm_helper"),
    ],
)
def test_sweep_errors_are_reported_with_position(changing, old, new, place, words):
    text = changing.read_text()
    assert old in text
    changing.write_text(text.replace(old, new))
    with pytest.raises(ReadError) as error:
        read_sweep(changing)
    assert error.value.lines[0].startswith(f"{changing}:{place}: error["), error.value.lines
    assert words in error.value.report


def test_sweep_errors_are_reported_in_one_pass(file):
    text = file.read_text().replace("runs: 6", "runs: 0").replace("sigma: 0.3", "c: 2")
    file.write_text(text.replace("window: 3", "window: 0"))
    with pytest.raises(ReadError) as error:
        read_sweep(file)
    places = [line.split(": ")[0].removeprefix(f"{file}:") for line in error.value.lines]
    assert places == ["3:7", "10:22", "13:28"]


def test_sweep_refusal_names_what_is_missing(changing, monkeypatch):
    text = changing.read_text()
    changing.write_text(text.replace("/persons", "/nobody"))
    with pytest.raises(BtAgentsError, match=r"nobody' is not an experiment: it has no experiment"):
        read_sweep(changing)
    others = "calm_helper: 2, first_guide: 2, playful_companion: 2, swift_assistant: 9"
    changing.write_text(text.replace("swift_assistant: 9", others))
    with pytest.raises(ReadError, match="in the first round nobody is there"):
        read_sweep(changing)
    monkeypatch.chdir(ROOT)
    assert find_sweep("told") == Path("experiments/sweeps/told.yaml")
    with pytest.raises(BtAgentsError, match=r"no sweep 'nobody'; there are .*persons, .*told, "):
        find_sweep("nobody")


def test_results_are_independent_of_number_of_processes(file, monkeypatch):
    spec = replace(read_sweep(file), rounds=8)
    one = sweep(spec, 1)
    two = sweep(spec, 2)
    assert [cell for cell, _ in one] == [cell for cell, _ in two]
    for (_, mine), (_, yours) in zip(one, two, strict=True):
        for name, values in vars(mine).items():
            assert np.array_equal(values, getattr(yours, name)), name
    # In parts as in one piece: only the order of the runs matters.
    monkeypatch.setattr(sweeping, "PART", 4)
    for (_, mine), (_, yours) in zip(one, sweep(spec, 1), strict=True):
        assert summary(mine) == summary(yours)
    assert [summary(r) for _, r in sweep(replace(spec, seed=8), 1)] != [
        summary(runs) for _, runs in one
    ]


def test_sweep_declares_late_agents_and_preference_changes(changing):
    world = read_sweep(changing).world
    assert world.absent == {"swift_assistant": 8}
    assert world.present_in(7).tolist() == [True, True, True, False]
    assert world.present_in(8).all()
    assert np.array_equal(world.best_in(9), world.best)
    assert world.best_in(10)[0].tolist() == [1.0, 1.0, 2.0]
    assert np.array_equal(world.best_in(10)[1:], world.best[1:])


def test_run_has_converged_once_all_later_rounds_correct():
    right = np.ones((3, 60), dtype=bool)
    right[0, :10] = False
    right[1, 59] = right[1, 58] = False
    assert converged(right).tolist() == [10.0, np.inf, 1.0]


def test_unusable_output_is_refused_before_computing(file, tmp_path):
    output = tmp_path / "file" / "results"
    output.parent.touch()
    words = ["experiment", "sweep", str(file), "--runs", "1", "--output", str(output)]
    result = CliRunner().invoke(bt_agents, words)
    assert "name a folder to write into" in str(result.exception)
    assert result.output == ""


def test_command_writes_table_numbers_and_figures(file, tmp_path, monkeypatch):
    # Small pictures are sufficient, and cheaper.
    monkeypatch.setattr(drawing, "_PNG_DPI", 30)
    output = tmp_path / "results"
    words = ["experiment", "sweep", str(file), "--processes", "1", "--output", str(output)]
    result = CliRunner().invoke(bt_agents, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "8 ways, 6 runs of 30 rounds each, seeds 7 to 12" in " ".join(result.output.split())
    with (output / "results.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert len(rows) == 8
    assert rows[-1]["strategy"] == "thompson sigma=0.3"
    assert rows[-1]["update"] == "median window=3"
    best = [row for row in rows if row["best"] == "True"]
    assert sorted(row["wrong_share"] for row in best) == ["0.0", "0.4"]
    for row in rows:
        (other,) = (one for one in best if one["wrong_share"] == row["wrong_share"])
        assert float(other["starved_share"]) <= float(row["starved_share"])
    assert sum(" * " in line for line in result.output.splitlines()) == 2
    assert (output / "table.md").read_text().count("| **") == 2
    document = json.loads((output / "results.json").read_text())
    assert [cell["wrong_share"] for cell in document["cells"]] == [0.0, 0.4] * 4
    assert len(document["cells"][0]["right_by_round"]) == 30
    assert (output / "table.md").read_text().count("\n| ") == 9
    for figure in ("curves.svg", "curves.png", "robustness.svg", "robustness.png"):
        assert (output / figure).stat().st_size > 1000


def shipped_rules() -> dict[str, LearningRule]:
    """Return the learning rule of each shipped agent that learns, and of a new one."""
    trees = read_trees(ROOT / "trees")
    fresh = new_agent("fresh", "trees", "fresh.yaml", trees.scene, trees.symbols.skills)
    agents = [*trees.agents, read_agent(Source("fresh.yaml", fresh), trees.symbols)]
    return {agent.name: agent.learning for agent in agents if agent.learning_rate}


def test_shipped_and_new_agents_use_huber_rule():
    rules = shipped_rules()
    assert len(rules) > 5
    assert set(map(repr, rules.values())) == {repr(LearningRule(update=Update.HUBER))}


@pytest.mark.parametrize("name", ["1", "2-aggressive", "2-conservative", "2-moderate", "3"])
def test_paper_experiments_keep_the_papers_rule(name):
    agents = read_trees(ROOT / "experiments" / name).agents
    assert {repr(agent.learning) for agent in agents} == {repr(LearningRule())}


@pytest.mark.parametrize("world", ["told", "persons"])
def test_with_the_defaults_nobody_starves(world):
    """docs/experiments.md makes the claim for 1,000 seeds; here are some of them."""
    spec = read_sweep(SWEEPS / f"{world}.yaml")
    learn = shipped_rules()["fresh"]
    streams = draw(spec.world, range(20), 250)
    found = {
        label: [
            summary(of_runs(spec.world, streams, simulate(spec.world, arm, streams, share)))
            for share in (0.0, 0.2)
        ]
        for label, arm in {
            "default": Arm(strategy=Settings().strategy, rule=learn),
            "ucb": Arm(strategy="ucb", options={"c": 6.0}, rule=learn),
            "paper": Arm(strategy="manhattan", rule=learn),
        }.items()
    }
    for ours, theirs in zip(found["default"], found["ucb"], strict=True):
        assert ours.starved.share == ours.never.share == 0.0
        assert ours.accuracy >= 0.99
        assert ours.worst >= 0.95
        assert world == "persons" or ours.regret < theirs.regret
    assert found["paper"][0].starved.share > 0.1, "by the paper's rule some do"
