# SPDX-License-Identifier: Apache-2.0
"""Estimates: the documented formulas, number by number."""

from __future__ import annotations

import math

import numpy
import pytest

from bt_agents_core.scene import SceneParameter, SceneSpace
from scene_layer.memory import DRIFT_S, FADES, Memory, Running

AGE = SceneParameter(name="age", minimum=1.0, maximum=5.0, default=3.0)
IGNORANCE = 4.0 / math.sqrt(12.0)


def running(*samples: tuple[float, float, float]) -> Running:
    """Return the estimate after samples of value, standard deviation and confidence."""
    found = Running()
    for value, std, confidence in samples:
        found = found.after(value, std, confidence, 0.0)
    return found


@pytest.mark.parametrize("count", [1, 2, 7, 300])
def test_estimate_is_weighted_mean_and_scatter_of_measurements(count):
    random = numpy.random.default_rng(count)
    values, stds = random.uniform(1.0, 5.0, count), random.uniform(0.0, 1.0, count)
    confidences = random.uniform(0.1, 1.0, count)
    found = running(*zip(values, stds, confidences, strict=True))
    weights = confidences * FADES ** numpy.arange(count - 1, -1, -1)
    mean = numpy.average(values, weights=weights)
    assert found.mean == pytest.approx(mean)
    assert found.weight == pytest.approx(weights.sum())
    assert found.scatter == pytest.approx(
        (weights * ((values - mean) ** 2 + stds**2)).sum(), abs=1e-12
    )


@pytest.mark.parametrize("age_s", [0.0, 1.0, 600.0, DRIFT_S, 1e7])
def test_uncertainty_grows_by_the_documented_formula(age_s):
    known = (0.5 + IGNORANCE**2) / (2.0 + 1.0)
    expected = known + (IGNORANCE**2 - known) * (1.0 - math.exp(-2.0 * age_s / DRIFT_S))
    found = Running(mean=4.0, scatter=0.5, weight=2.0, at=0.0)
    assert found.std(IGNORANCE, age_s) == pytest.approx(math.sqrt(expected))


def test_deviation_without_measurements_is_that_of_range():
    assert AGE.ignorance == IGNORANCE


def test_snapshot_is_unaffected_by_later_changes():
    memory = Memory(SceneSpace(parameters=(AGE,)))
    memory.came("anna", 0.0)
    memory.measured("anna", "age", 4.0, 0.0, 1.0, 0.0)
    memory.left("anna", "lobby", known=True, now=1.0)
    persons, places = memory.snapshot()
    memory.came("anna", 2.0)
    memory.measured("anna", "age", 1.0, 0.0, 1.0, 3.0)
    memory.left("anna", "lobby", known=True, now=4.0)
    assert (persons["anna"].visits, persons["anna"].values["age"].mean) == (1, 4.0)
    assert (places["lobby"].visits, places["lobby"].values["age"].mean) == (1, 4.0)
