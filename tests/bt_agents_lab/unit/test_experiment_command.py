# SPDX-License-Identifier: Apache-2.0
"""`bt-agents experiment run`: its refusals, its files, and its report on profiles."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.cli import experiment
from bt_agents_lab.cli.through_ros import prepared_experiment
from bt_agents_lab.experiments.core import through_core
from bt_agents_lab.experiments.replicas import opened
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.yaml.source import Source
from bt_agents_tools.cli.main import bt_agents
from checkout import ROOT
from marketplace_node.strategies import STRATEGIES, StrategySpec, catalogue

EXPERIMENTS = ROOT / "experiments"
FILE = "experiment.yaml"
OWN, LAST = (
    f"    agent_{number}: {{age: {number}, profession: {number}, emotion: {number}}}\n"
    for number in (3, 5)
)
ROWS = "[{age: 3, profession: 3, emotion: 3}, {age: 1, profession: 2, emotion: 5}]"
LISTS = f"  sequences:\n    agent_3: {ROWS}\n  repeat: true\n"
LISTED = ((FILE, OWN, ""), (FILE, LAST, LAST + LISTS))
"""Changes of the paper's third experiment: a list of feedback for one agent."""
HUBER = (("agents/agent_1.yaml", "learning_rate: 0.2", "learning: {rate: 0.2, update: huber}"),)
NO_FORM = "not compared with the closed form, as"


def changed(into: Path, name: str, *changes: tuple[str, str, str]) -> Path:
    """Return a copy of an experiment with other texts in its files."""
    folder = shutil.copytree(EXPERIMENTS / name, into / name)
    for file, old, new in changes:
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new))
    return folder


def run(*words: str) -> Result:
    command = ["experiment", "run", *words, "--rounds", "12"]
    return CliRunner().invoke(bt_agents, command, env={"COLUMNS": "80"})


@pytest.mark.parametrize("strategy", ["external", "rules"])
def test_strategy_needing_more_than_bids_is_rejected(strategy):
    refusal = run(str(EXPERIMENTS / "3"), "--strategy", strategy).exception
    assert isinstance(refusal, BtAgentsError)
    assert f"strategy '{strategy}' is not simulated" in str(refusal)
    assert "take one of manhattan," in str(refusal)


@pytest.mark.parametrize("fails", [False, True])
def test_strategy_of_a_package_is_simulated(fails: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def add_installed() -> tuple[str, ...]:
        score = (lambda *_: []) if fails else STRATEGIES["manhattan"].score
        theirs = StrategySpec(name="theirs", description="Of somebody else.", score=score)
        monkeypatch.setitem(catalogue._ALL, "theirs", theirs)
        return ("strategy 'other' cannot be loaded",)

    monkeypatch.setattr(experiment, "add_installed", add_installed)
    ended = run(str(EXPERIMENTS / "3"), "--strategy", "theirs")
    assert ended.stderr.startswith("strategy 'other' cannot be loaded\n")
    assert ended.exit_code == int(fails)
    if fails:
        assert str(ended.exception).startswith("strategy theirs: it returns 0 scores for ")


def test_missing_feedback_for_scene_error_suggests_fix(tmp_path):
    folder, spec = opened(changed(tmp_path, "3", (FILE, OWN, "")))
    with pytest.raises(BtAgentsError, match=r"^scene \d+ led to no feedback, .*under 'each'"):
        through_core(folder, spec)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("nowhere/rounds.csv", "rounds.csv cannot be written: No such file or directory"),
        ("rounds.xlsx", "rounds.xlsx ends in '.xlsx', expected .csv or .parquet"),
    ],
)
def test_unusable_table_is_reported_before_any_run(tmp_path, table, words):
    result = run(str(EXPERIMENTS / "1"), "--out", str(tmp_path / table))
    assert isinstance(result.exception, BtAgentsError)
    assert words in str(result.exception)
    assert result.output == ""


def test_table_has_every_round(tmp_path):
    table = tmp_path / "rounds.csv"
    table.write_text("what was there before\n")
    assert run(str(EXPERIMENTS / "1"), "--out", str(table)).exit_code == 0
    lines = table.read_text().splitlines()
    assert lines[0].startswith("row,epoch,round,")
    rounds = [line.split(",")[2] for line in lines if line.startswith("round,")]
    assert rounds == [str(n) for n in range(1, 13)]


def test_each_part_names_its_file_of_results(tmp_path, monkeypatch):
    monkeypatch.chdir(EXPERIMENTS.parent)
    result = run("2", "--rounds", "1", "--out", str(tmp_path / "all.csv"))
    written = [line for line in result.output.splitlines() if line.startswith("written to ")]
    assert written == [f"written to {path}" for path in sorted(tmp_path.glob("all-2-*.csv"))]
    assert len(written) == 3


def test_vector_stays_on_one_80_column_line():
    result = run(str(EXPERIMENTS / "recommended"))
    rows = [line for line in result.output.splitlines() if line.startswith("agent_")]
    assert len(rows) == 3
    assert all(row.count("[") == row.count("]") == 3 for row in rows)


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("1", (), "equal, largest difference"),
        ("recommended", (), f"{NO_FORM} some of the feedback is wrong"),
        ("1", HUBER, f"{NO_FORM} agent_1 does not learn by the paper's"),
        ("3", LISTED, f"{NO_FORM} agent_3 does not get the same feedback after each run"),
    ],
)
def test_command_states_whether_closed_form_exists(tmp_path, name, changes, said):
    result = run(str(changed(tmp_path, name, *changes)))
    assert result.exit_code == 0
    assert said in " ".join(result.output.split())


def test_feedback_for_an_unknown_agent_is_refused(tmp_path):
    misspelt = changed(tmp_path, "3", (FILE, "agent_5:", "agent_55:"))
    told = str(run(str(misspelt)).exception)
    assert told.endswith("'agent_55', which is no agent of it; did you mean 'agent_5'?")


def test_exhausted_feedback_list_error_suggests_fix(tmp_path):
    once = changed(tmp_path, "3", *LISTED, (FILE, "repeat: true", "repeat: false"))
    refusal = run(str(once), "--seed", "3").exception
    assert isinstance(refusal, BtAgentsError)
    assert "let each list be long enough, or 'repeat: true'" in str(refusal)


def test_feedback_node_receives_the_same_lists(tmp_path):
    folder, spec = opened(changed(tmp_path, "3", *LISTED))
    space = folder.scene.space
    again = read_experiment(Source("prepared.json", prepared_experiment(spec, space)), space)
    assert again.feedback == spec.feedback
