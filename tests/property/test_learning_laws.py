# SPDX-License-Identifier: Apache-2.0
"""Laws of learning that hold for every profile, target and rate."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_agents.scene import SceneParameter, SceneSpace
from feedback_node import learning

RANGES = ((1.0, 5.0), (-1.0, 1.0), (0.0, 1e6))
SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=f"p{index}", minimum=low, maximum=high, default=low)
        for index, (low, high) in enumerate(RANGES)
    )
)
profiles = st.tuples(*(st.floats(low, high) for low, high in RANGES))
targets = st.tuples(*(st.floats(low, high) | st.just(math.nan) for low, high in RANGES)).filter(
    lambda vector: not all(map(math.isnan, vector))
)
rates = st.floats(0.0, 1.0)
rules = st.sampled_from([learning.direct, learning.positive, learning.negative, learning.assigned])


@given(rules, profiles, targets, rates)
def test_a_profile_never_leaves_its_ranges(rule, profile, target, rate):
    SPACE.vector(rule(profile, target, rate, SPACE).after)


@given(profiles, targets, rates)
def test_direct_feedback_never_overshoots(profile, target, rate):
    after = learning.direct(profile, target, rate, SPACE).after
    for p, f, moved in zip(profile, target, after, strict=True):
        assert moved == p if math.isnan(f) else min(p, f) <= moved <= max(p, f)


@given(profiles, targets, rates)
def test_negative_feedback_never_comes_closer(profile, target, rate):
    after = learning.negative(profile, target, rate, SPACE).after
    for p, f, moved in zip(profile, target, after, strict=True):
        assert moved == p if math.isnan(f) else abs(moved - f) >= abs(p - f)


@given(rules, profiles, targets, rates)
def test_what_has_no_opinion_stays_to_the_last_digit(rule, profile, target, rate):
    after = rule(profile, target, rate, SPACE).after
    assert [a for a, f in zip(after, target, strict=True) if math.isnan(f)] == [
        p for p, f in zip(profile, target, strict=True) if math.isnan(f)
    ]


@given(
    st.tuples(st.floats(1.0, 5.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0)),
    st.tuples(st.floats(1.0, 5.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0)),
    rates,
    st.integers(0, 60),
)
def test_repeated_feedback_follows_the_closed_form(profile, target, rate, count):
    moved = profile
    for _ in range(count):
        moved = learning.direct(moved, target, rate, SPACE).after
    expected = [f + (p - f) * (1 - rate) ** count for p, f in zip(profile, target, strict=True)]
    assert moved == pytest.approx(expected, abs=1e-9, rel=0)
