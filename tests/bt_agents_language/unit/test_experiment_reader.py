# SPDX-License-Identifier: Apache-2.0
"""Experiment files: scenes and the feedback after them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.yaml.source import Source
from feedback_node.simulated_feedback import SimulatedFeedback

EXPERIMENTS = Path(__file__).parents[3] / "experiments"
SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1, maximum=5, default=3) for name in ("age", "mood")
    )
)
TEXT = """\
format: 1
title: T
rounds: 4
seed: 7
scenes: [{mood: 2, age: 1}]
feedback:
  each: {guide: {age: 5, mood: 4}}
  sequence: [{age: 3}]
  repeat: true
  errors: {share: 0.25}
"""


def test_an_experiment_is_read():
    spec = read_experiment(Source("e.yaml", TEXT), SPACE)
    assert (spec.title, spec.rounds, spec.seed, spec.scenes) == ("T", 4, 7, ((1.0, 2.0),))
    assert spec.order() == ((1.0, 2.0),) * 4
    errors = spec.feedback.errors
    assert (errors.seed, errors.every, errors.share, errors.value) == (7, 0, 0.25, None)
    simulated = SimulatedFeedback(replace(spec.feedback, errors=None))
    assert simulated.next("guide") == (5.0, 4.0)
    for _ in range(2):
        age, mood = simulated.next("another") or ()
        assert age == 3.0
        # A missing value of feedback means no opinion.
        assert math.isnan(mood)


def test_each_agent_may_have_own_feedback_sequence():
    sequences = "sequences: {lift: [{age: 1, mood: 2}, {age: 4, mood: 5}]}"
    text = TEXT.replace("sequence: [{age: 3}]", sequences)
    spec = read_experiment(Source("e.yaml", text), SPACE)
    assert spec.feedback.sequences == {"lift": ((1.0, 2.0), (4.0, 5.0))}
    simulated = SimulatedFeedback(replace(spec.feedback, errors=None))
    ran = ("lift", "guide", "lift", "lift")
    assert [simulated.next(agent) for agent in ran] == [(1, 2), (5, 4), (4, 5), (1, 2)]


@pytest.mark.parametrize(
    "path", sorted(EXPERIMENTS.glob("*/experiment.yaml")), ids=lambda path: path.parent.name
)
def test_shipped_experiments_are_read(path):
    trees = read_trees(path.parent)
    assert trees.broken == ()
    feedback = read_experiment(path, trees.scene.space).feedback
    assert set(feedback.each) == {one.name for one in trees.agents}


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("sequence: [{age: 3}]", "sequences: {lift: [{age: 3}, {mood: 6}]}", "8:39"),
        ("sequence: [{age: 3}]", "sequences: {Lift 1: [{age: 3}]}", "8:15"),
        ("share: 0.25", "every: 0", "10:19"),
        ("share: 0.25", "value: {age: 5, mood: 5}", "10:11"),
        ("share: 0.25", "every: 3, value: {age: 5}", "10:29"),
        ("share: 0.25", "every: 3, value: {age: 5, mood: 9}", "10:44"),
    ],
)
def test_errors_are_reported_with_position(old, new, place):
    with pytest.raises(ReadError) as error:
        read_experiment(Source("e.yaml", TEXT.replace(old, new)), SPACE)
    (line,) = error.value.lines
    assert line.startswith(f"e.yaml:{place}: error[")
