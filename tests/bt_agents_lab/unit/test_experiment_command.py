# SPDX-License-Identifier: Apache-2.0
"""`bt-agents experiment run`: what it refuses, what it writes, what it says of the profiles."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.experiments.core import through_core
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_tools.cli.main import bt_agents
from checkout import ROOT

EXPERIMENTS = ROOT / "experiments"


def run(*words: str) -> Result:
    command = ["experiment", "run", *words, "--rounds", "12"]
    return CliRunner().invoke(bt_agents, command, env={"COLUMNS": "80"})


@pytest.mark.parametrize("strategy", ["external", "rules"])
def test_a_strategy_that_needs_more_than_the_bids_is_refused(strategy):
    refusal = run(str(EXPERIMENTS / "3"), "--strategy", strategy).exception
    assert isinstance(refusal, BtAgentsError)
    assert f"strategy '{strategy}' is not simulated" in str(refusal)
    assert "take one of manhattan," in str(refusal)


def test_a_scene_without_feedback_is_said_with_what_to_write(tmp_path):
    shutil.copytree(EXPERIMENTS / "3", tmp_path / "3")
    file = tmp_path / "3" / "experiment.yaml"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(line for line in lines if not line.lstrip().startswith("agent_3:")))
    folder = read_trees(tmp_path / "3")
    with pytest.raises(BtAgentsError, match=r"^scene \d+ led to no feedback, .*under 'each'"):
        through_core(folder, read_experiment(file, folder.scene.space))


def test_a_table_that_cannot_be_written_is_said_before_anything_runs(tmp_path):
    table = tmp_path / "nowhere" / "rounds.csv"
    result = run(str(EXPERIMENTS / "1"), "--out", str(table))
    assert isinstance(result.exception, BtAgentsError)
    assert f"{table} cannot be written: No such file or directory" in str(result.exception)
    assert result.output == ""


def test_the_table_has_every_round(tmp_path):
    table = tmp_path / "rounds.csv"
    table.write_text("what was there before\n")
    assert run(str(EXPERIMENTS / "1"), "--out", str(table)).exit_code == 0
    lines = table.read_text().splitlines()
    assert lines[0].startswith("row,epoch,round,")
    rounds = [line.split(",")[2] for line in lines if line.startswith("round,")]
    assert rounds == [str(n) for n in range(1, 13)]


def test_a_vector_stays_on_one_line_of_80_columns():
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
def test_it_is_said_whether_there_is_a_closed_form(name: str, said: str, tmp_path: Path):
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
