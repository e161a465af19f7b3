# SPDX-License-Identifier: Apache-2.0
"""`bt-agents experiment run`: its refusals, its files, and its report on profiles."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.cli.through_ros import prepared_experiment
from bt_agents_lab.experiments.core import through_core
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.yaml.source import Source
from bt_agents_tools.cli.main import bt_agents
from checkout import ROOT

EXPERIMENTS = ROOT / "experiments"


def run(*words: str) -> Result:
    command = ["experiment", "run", *words, "--rounds", "12"]
    return CliRunner().invoke(bt_agents, command, env={"COLUMNS": "80"})


@pytest.mark.parametrize("strategy", ["external", "rules"])
def test_strategy_needing_more_than_bids_is_rejected(strategy):
    refusal = run(str(EXPERIMENTS / "3"), "--strategy", strategy).exception
    assert isinstance(refusal, BtAgentsError)
    assert f"strategy '{strategy}' is not simulated" in str(refusal)
    assert "take one of manhattan," in str(refusal)


def test_missing_feedback_for_scene_error_suggests_fix(tmp_path):
    shutil.copytree(EXPERIMENTS / "3", tmp_path / "3")
    file = tmp_path / "3" / "experiment.yaml"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(line for line in lines if not line.lstrip().startswith("agent_3:")))
    folder = read_trees(tmp_path / "3")
    with pytest.raises(BtAgentsError, match=r"^scene \d+ led to no feedback, .*under 'each'"):
        through_core(folder, read_experiment(file, folder.scene.space))


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


def test_vector_stays_on_one_80_column_line():
    result = run(str(EXPERIMENTS / "recommended"))
    rows = [line for line in result.output.splitlines() if line.startswith("agent_")]
    assert len(rows) == 3
    assert all(row.count("[") == row.count("]") == 3 for row in rows)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("1", "equal, largest difference"),
        ("recommended", "not compared with the closed form, as some of the feedback is wrong"),
        ("huber", "not compared with the closed form, as agent_1 does not learn by the paper's"),
    ],
)
def test_command_states_whether_closed_form_exists(name: str, said: str, tmp_path: Path):
    folder = EXPERIMENTS / name
    if name == "huber":
        folder = tmp_path / name
        shutil.copytree(EXPERIMENTS / "1", folder)
        (agent,) = (folder / "agents").glob("*.yaml")
        rate = next(line for line in agent.read_text().splitlines() if "rate" in line)
        huber = "learning: {rate: 0.2, update: huber}"
        agent.write_text(agent.read_text().replace(rate, huber))
    result = run(str(folder))
    assert result.exit_code == 0
    assert said in " ".join(result.output.split())


@pytest.fixture
def listed(tmp_path: Path) -> Path:
    """Return the paper's third experiment, with a list of feedback for one agent."""
    folder = shutil.copytree(EXPERIMENTS / "3", tmp_path / "3")
    file = folder / "experiment.yaml"
    text = file.read_text()
    own = "    agent_3: {age: 3, profession: 3, emotion: 3}\n"
    assert own in text
    rows = "[{age: 3, profession: 3, emotion: 3}, {age: 1, profession: 2, emotion: 5}]"
    lists = f"  sequences:\n    agent_3: {rows}\n  repeat: true\n"
    file.write_text(text.replace(own, "") + lists)
    return folder


def test_feedback_list_is_reported_without_closed_form(listed):
    result = run(str(listed))
    assert result.exit_code == 0
    assert "agent_3 does not get the same feedback after each run" in " ".join(
        result.output.split()
    )


def test_exhausted_feedback_list_error_suggests_fix(listed):
    file = listed / "experiment.yaml"
    file.write_text(file.read_text().replace("repeat: true", "repeat: false"))
    refusal = run(str(listed), "--seed", "3").exception
    assert isinstance(refusal, BtAgentsError)
    assert "let each list be long enough, or 'repeat: true'" in str(refusal)


def test_feedback_node_receives_the_same_lists(listed):
    space = read_trees(listed).scene.space
    spec = read_experiment(listed / "experiment.yaml", space)
    again = read_experiment(Source("prepared.json", prepared_experiment(spec, space)), space)
    assert again.feedback == spec.feedback
