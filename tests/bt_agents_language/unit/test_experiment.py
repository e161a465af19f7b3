# SPDX-License-Identifier: Apache-2.0
"""The closed form of the paper's learning rule and the seeded order of scenes."""

from __future__ import annotations

import pytest

from bt_agents_language.model.experiment import (
    ExperimentSpec,
    FeedbackRecord,
    PreparedFeedback,
    closed_form,
    deviation,
    difference,
)


def spec(seed: int) -> ExperimentSpec:
    return ExperimentSpec(
        title="t",
        rounds=30,
        seed=seed,
        scenes=((1.0,), (3.0,), (5.0,)),
        feedback=PreparedFeedback(each={"a": (5.0,)}),
    )


def test_closed_form_equals_repeated_update() -> None:
    profile = (2.5, 2.5, 2.5)
    target = (5.0, 4.0, 1.0)
    for cycle in range(1, 101):
        profile = tuple(p + 0.2 * (f - p) for p, f in zip(profile, target, strict=True))
        assert closed_form((2.5, 2.5, 2.5), target, 0.2, cycle) == pytest.approx(
            profile, abs=1e-12
        )


@pytest.mark.parametrize(("rate", "cycles"), [(0.05, 92), (0.2, 22), (0.5, 7)])
def test_convergence_cycles_to_l1_threshold_match_learning_rate(rate: float, cycles: int) -> None:
    target = (5.0, 4.0, 1.0)

    def error(n: int) -> float:
        profile = closed_form((2.5, 2.5, 2.5), target, rate, n)
        return sum(abs(p - f) for p, f in zip(profile, target, strict=True))

    assert error(cycles) < 0.05 <= error(cycles - 1)


def test_scene_order_depends_only_on_seed() -> None:
    assert spec(1).order() == spec(1).order()
    assert spec(1).order() != spec(2).order()
    assert set(spec(1).order()) == {(1.0,), (3.0,), (5.0,)}


def test_deviation_finds_single_deviating_round() -> None:
    good = [
        FeedbackRecord(round=1, scene=(5.0,), winner="a", before=(1.0,), after=(3.0,)),
        FeedbackRecord(round=2, scene=(5.0,), winner="a", before=(3.0,), after=(4.0,)),
    ]
    arguments = ({"a": (5.0,)}, {"a": (1.0,)}, {"a": 0.5})
    assert deviation(good, *arguments) == 0.0
    off = [
        good[0],
        FeedbackRecord(round=2, scene=(5.0,), winner="a", before=(3.0,), after=(4.001,)),
    ]
    assert deviation(off, *arguments) == pytest.approx(0.001)


def test_recording_difference_is_largest_profile_difference_or_infinite() -> None:
    one = [FeedbackRecord(round=1, scene=(5.0,), winner="a", before=(1.0,), after=(3.0,))]
    near = [FeedbackRecord(round=7, scene=(5.0,), winner="a", before=(1.0,), after=(3.25,))]
    other = [FeedbackRecord(round=1, scene=(5.0,), winner="b", before=(1.0,), after=(3.0,))]
    assert difference(one, one) == 0.0
    assert difference(one, near) == 0.25
    assert difference(one, other) == difference(one, []) == float("inf")


def test_shortened_experiment_keeps_its_prefix() -> None:
    assert spec(1).shortened(10).order() == spec(1).order()[:10]
