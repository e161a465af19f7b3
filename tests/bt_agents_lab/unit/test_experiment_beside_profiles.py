# SPDX-License-Identifier: Apache-2.0
"""Experiments with scene parameters outside profiles: market, host and feedback node together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bt_agents_lab.experiments.core import through_core
from bt_agents_lab.experiments.replicas import opened, replicas, world_of
from bt_agents_lab.results import ResultFile

SCENE = """\
format: 1
parameters:
  pain: {min: 0, max: 10, default: 0, profile: false}
  age: {min: 1, max: 5, default: 3}
"""
AGENT = """\
format: 1
agent: NAME
profile: {age: AGE}
learning_rate: 0.5
tree: {wait: 1 s}
"""
EXPERIMENT = """\
format: 1
title: pain
rounds: 4
seed: 1
scenes: [{age: 5, pain: 9}, {age: 2, pain: 0}]
feedback: {each: {nurse: {age: 4}, clown: {age: 1}}}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "agents").mkdir()
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "experiment.yaml").write_text(EXPERIMENT)
    for name, age in (("nurse", "5"), ("clown", "1")):
        text = AGENT.replace("NAME", name).replace("AGE", age)
        (tmp_path / "agents" / f"{name}.yaml").write_text(text)
    return tmp_path


def test_bids_and_profile_changes_omit_unprofiled_parameter(folder: Path) -> None:
    trees, spec = opened(folder)
    rows: list = []
    records = through_core(trees, spec, on_result=rows.append)
    assert tuple(one.scene for one in records) == tuple(spec.order())
    assert {len(one.scene) for one in records} == {2}
    assert {len(one.after) for one in records} == {1}
    bids = [row for row in rows if row["row"] == "bid"]
    assert all("value_age" in row and "value_pain" not in row for row in bids)
    assert all("value_pain" in row for row in rows if row["row"] == "round")
    ResultFile(folder / "out.csv").write(trees.scene.space.names, rows)
    # The batched simulation gives the same result.
    world = world_of(trees, spec)
    assert world.space.names == ("age",)
    course = replicas(world, spec, [spec.seed]).course
    winners = [world.agents[one] for one in np.asarray(course.awarded)[0]]
    assert winners == [one.winner for one in records]
