# SPDX-License-Identifier: Apache-2.0
"""Bandits as baselines: rewarded for what suits, and played as the agents are."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.experiments.bandits import BANDITS, Bandits
from bt_agents_lab.experiments.measures import of_runs
from bt_agents_lab.experiments.random_streams import draw
from bt_agents_lab.experiments.simulated_world import Arm
from bt_agents_lab.experiments.simulation import simulate
from bt_agents_lab.experiments.sweep_reader import read_sweep
from bt_agents_tools.cli.main import bt_agents
from checkout import ROOT

SWEEPS = ROOT / "experiments" / "sweeps"


@pytest.mark.parametrize("name", BANDITS)
def test_a_bandit_finds_out_who_suits_a_scene(name):
    world = read_sweep(SWEEPS / "told.yaml").world
    bandits = Bandits(name, {"alpha": 0.1, "epsilon": 0.0}, world, [1, 2])
    runs = np.arange(2)
    # A straight line tells the first agent from the last one, not from the one between.
    excluded = np.array([[False, True, False]] * 2)
    chance = np.random.default_rng(1)
    right = []
    for _ in range(60):
        places = chance.choice([0, 2], 2)
        scene = world.scenes[places]
        chosen = bandits.award(runs, scene, excluded, chance.random((2, 3)))
        suits = chosen == places
        bandits.learn(runs, scene, chosen, np.where(suits, 1.0, -1.0))
        right.append(suits)
    assert np.mean(right[-20:]) >= 0.9


def test_a_bandit_takes_nobody_who_is_excluded():
    world = read_sweep(SWEEPS / "told.yaml").world
    bandits = Bandits("linucb", {}, world, [1])
    row, scene = np.arange(1), world.scenes[:1]
    bandits.learn(row, scene, np.array([0]), np.ones(1))
    for excluded, taken in (([False, True, True], 0), ([True, False, True], 1)):
        chosen = bandits.award(row, scene, np.array([excluded]), np.zeros((1, 3)))
        assert chosen.tolist() == [taken]


@pytest.mark.parametrize("name", BANDITS)
def test_a_bandit_gives_nothing_to_an_agent_that_is_not_there_and_no_scene_twice(name):
    world = read_sweep(SWEEPS / "late.yaml").world
    world = replace(world, absent={"swift_assistant": 12})
    late = world.agents.index("swift_assistant")
    streams = draw(world, range(2), 24)
    course = simulate(world, Arm(strategy=name), streams, 0.2)
    assert not course.won[:, :12, late].any()
    assert (course.won.sum(axis=-1) <= world.present_in(23).sum()).all()
    assert course.cancelled.any()
    # It has no profiles.
    assert np.isnan(of_runs(world, streams, course).error).all()


def test_a_bandit_runs_the_same_whichever_others_run_with_it():
    world = read_sweep(SWEEPS / "told.yaml").world
    arm = Arm(strategy="lints")
    together = simulate(world, arm, draw(world, [3, 4], 12), 0.2)
    alone = simulate(world, arm, draw(world, [4], 12), 0.2)
    assert together.awarded[1].tolist() == alone.awarded[0].tolist()


def test_a_sweep_measures_bandits_beside_strategies_once_for_all_learning_rules(tmp_path):
    file = tmp_path / "small.yaml"
    file.write_text(
        f"format: 1\nexperiment: {ROOT}/experiments/3\nruns: 2\nrounds: 12\nseed: 1\n"
        "strategies: [manhattan, linucb]\nupdates: [plain, median]\n"
    )
    words = ["experiment", "sweep", str(file), "--processes", "1", "--json"]
    result = CliRunner().invoke(bt_agents, words, catch_exceptions=False)
    cells = json.loads(result.stdout)
    assert [cell["strategy"] for cell in cells] == ["manhattan"] * 2 + ["linucb"] * 2
    assert [cell["error"] is None for cell in cells] == [False, False, True, True]
    both = {"update": "", "best": None}
    assert cells[2] | both == cells[3] | both
    shown = CliRunner().invoke(bt_agents, words[:-1], catch_exceptions=False)
    assert "linucb" in shown.output


def test_without_the_library_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mabwiser", None)
    world = read_sweep(SWEEPS / "told.yaml").world
    with pytest.raises(BtAgentsError, match=r"linucb needs MABWiser.*bt-agents\[lab\]"):
        Bandits("linucb", {}, world, [1])
