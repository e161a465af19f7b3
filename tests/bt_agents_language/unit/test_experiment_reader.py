# SPDX-License-Identifier: Apache-2.0
"""Experiments: their files, the order of their scenes, and what their learning must come to."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from agent_texts import refusal
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.model.experiment import (
    ExperimentSpec,
    FeedbackRecord,
    PreparedFeedback,
    closed_form,
    deviation,
    difference,
)
from bt_agents_language.yaml.source import Source

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
    assert spec.feedback.each == {"guide": (5.0, 4.0)}
    # A missing value of feedback means no opinion.
    assert spec.feedback.sequence == (pytest.approx((3.0, math.nan), nan_ok=True),)
    assert spec.feedback.repeat


def test_each_agent_may_have_own_feedback_sequence():
    sequences = "sequences: {lift: [{age: 1, mood: 2}, {age: 4, mood: 5}]}"
    text = TEXT.replace("sequence: [{age: 3}]", sequences)
    feedback = read_experiment(Source("e.yaml", text), SPACE).feedback
    assert feedback.sequences == {"lift": ((1.0, 2.0), (4.0, 5.0))}


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
    source = Source("e.yaml", TEXT.replace(old, new))
    (line,) = refusal(read_experiment, source, SPACE).lines
    assert line.startswith(f"e.yaml:{place}: error[")


def spec(seed: int) -> ExperimentSpec:
    return ExperimentSpec(
        title="t",
        rounds=30,
        seed=seed,
        scenes=((1.0,), (3.0,), (5.0,)),
        feedback=PreparedFeedback(each={"a": (5.0,)}),
    )


@pytest.mark.parametrize("rate", [0.05, 0.2, 0.5])
def test_closed_form_equals_repeated_update(rate: float) -> None:
    begin, target = (2.5, 2.5, 2.5), (5.0, 4.0, 1.0)
    profile = begin
    for cycle in range(1, 101):
        profile = tuple(p + rate * (f - p) for p, f in zip(profile, target, strict=True))
        expected = pytest.approx(profile, abs=1e-12)
        assert closed_form(begin, target, rate, cycle) == expected


def test_scene_order_depends_only_on_seed() -> None:
    assert spec(1).order() == spec(1).order()
    assert spec(1).order() != spec(2).order()
    assert set(spec(1).order()) == {(1.0,), (3.0,), (5.0,)}
    assert spec(1).shortened(10).order() == spec(1).order()[:10]


def record(after: float, round_: int = 1, winner: str = "a") -> FeedbackRecord:
    return FeedbackRecord(round=round_, scene=(5.0,), winner=winner, before=(1.0,), after=(after,))


def test_deviation_finds_single_deviating_round() -> None:
    first = record(3.0)
    arguments = ({"a": (5.0,)}, {"a": (1.0,)}, {"a": 0.5})
    assert deviation([first, replace(record(4.0, 2), before=(3.0,))], *arguments) == 0.0
    off = [first, replace(record(4.001, 2), before=(3.0,))]
    assert deviation(off, *arguments) == pytest.approx(0.001)


def test_recording_difference_is_largest_profile_difference_or_infinite() -> None:
    one = [record(3.0)]
    assert difference(one, one) == 0.0
    assert difference(one, [record(3.25, 7)]) == 0.25
    assert difference(one, [record(3.0, winner="b")]) == difference(one, []) == float("inf")
