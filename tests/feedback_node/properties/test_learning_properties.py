# SPDX-License-Identifier: Apache-2.0
"""Laws of learning that hold for every profile, target and rate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.scene import SceneParameter, SceneSpace, Vector
from feedback_node.learning import learning_step

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
kinds = st.sampled_from(FeedbackKind)
learned = st.sampled_from([FeedbackKind.DIRECT, FeedbackKind.POSITIVE, FeedbackKind.NEGATIVE])
weights = st.floats(0.0, 3.0)


def by_parameter(
    values: Callable[[float, float], st.SearchStrategy[float]],
) -> st.SearchStrategy[dict[str, float]]:
    return st.fixed_dictionaries(
        {}, optional={name: values(*ends) for name, ends in zip(SPACE.names, RANGES, strict=True)}
    )


def widths(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(0.0, high - low)


rules = st.builds(
    LearningRule,
    rates=by_parameter(lambda _low, _high: rates),
    update=st.sampled_from(Update),
    width=by_parameter(widths),
    window=st.integers(1, 7),
    anneal=st.floats(0.0, 10.0),
    drift=by_parameter(widths),
    retreat=by_parameter(st.floats),
)


def lessons(kinds: st.SearchStrategy[FeedbackKind]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries(
        {
            "kind": kinds,
            "profile": profiles,
            "target": targets,
            "rate": rates,
            "rule": rules,
            "weight": weights,
            "recent": st.lists(targets, max_size=8).map(tuple),
            "changes": st.integers(0, 1000),
            "authored": profiles,
        }
    )


def step(kind: FeedbackKind, profile: Vector, target: Vector, rate: float, **more: Any) -> Vector:
    return learning_step.step(kind, profile, target, rate=rate, space=SPACE, **more).after


@given(lessons(kinds))
def test_profile_never_leaves_its_ranges(lesson):
    SPACE.vector(step(**lesson))


@given(lessons(learned))
def test_profile_never_drifts_beyond_its_limit(lesson):
    rows = zip(SPACE.names, lesson["profile"], step(**lesson), lesson["authored"], strict=True)
    for name, before, now, authored in rows:
        drift = lesson["rule"].drift.get(name, math.inf)
        assert min(before, authored - drift) <= now <= max(before, authored + drift)


@given(lessons(kinds))
def test_values_without_opinion_stay_exactly_the_same(lesson):
    rows = zip(lesson["profile"], lesson["target"], step(**lesson), strict=True)
    assert not [1 for before, wanted, now in rows if math.isnan(wanted) and now != before]


@given(lessons(learned))
def test_frozen_or_zero_weight_values_do_not_move(lesson):
    frozen = replace(lesson["rule"], rates=dict.fromkeys(SPACE.names, 0.0))
    assert step(**lesson | {"rule": frozen}) == lesson["profile"]
    assert step(**lesson | {"weight": 0.0}) == lesson["profile"]


@given(profiles, targets, rates, rules.filter(lambda rule: rule.update != Update.MEDIAN), weights)
def test_direct_feedback_never_overshoots_or_moves_away(profile, target, rate, rule, weight):
    after = step(FeedbackKind.DIRECT, profile, target, rate, rule=rule, weight=weight)
    for p, f, moved in zip(profile, target, after, strict=True):
        assert moved == p if math.isnan(f) else min(p, f) <= moved <= max(p, f)


@given(profiles, targets, rates, rules.filter(lambda rule: rule.update != Update.MEDIAN), weights)
def test_negative_feedback_never_moves_closer(profile, target, rate, rule, weight):
    after = step(FeedbackKind.NEGATIVE, profile, target, rate, rule=rule, weight=weight)
    same = [(high - low) * learning_step.SAME_SHARE for low, high in RANGES]
    for p, f, moved, on_it in zip(profile, target, after, same, strict=True):
        # Within that distance, the profile equals the scene, and retreats to either side.
        closest = 0.0 if rule.retreat and abs(p - f) <= on_it else abs(p - f)
        assert moved == p if math.isnan(f) else abs(moved - f) >= closest


@given(profiles, st.floats(0.01, 1.0), rules, st.sampled_from([Update.PLAIN, Update.HUBER]))
def test_negative_on_exact_scene_equals_direct_to_retreat(profile, rate, rule, update):
    rule = replace(rule, update=update)
    retreat = tuple(rule.retreat.get(name, math.nan) for name in SPACE.names)
    after = step(FeedbackKind.NEGATIVE, profile, profile, rate, rule=rule)
    if all(map(math.isnan, retreat)):
        assert after == profile
    else:
        assert after == step(FeedbackKind.DIRECT, profile, retreat, rate, rule=rule)


@given(profiles, targets, st.floats(0.0, 0.3), st.floats(0.0, 3.0))
def test_weight_scales_the_rate(profile, target, rate, weight):
    weighed = step(FeedbackKind.DIRECT, profile, target, rate, weight=weight)
    assert weighed == step(FeedbackKind.DIRECT, profile, target, rate * weight)


@given(
    st.tuples(st.floats(1.0, 5.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0)),
    st.tuples(st.floats(1.0, 5.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0)),
    rates,
    st.integers(0, 60),
)
def test_repeated_feedback_follows_the_closed_form(profile, target, rate, count):
    moved = profile
    for _ in range(count):
        moved = step(FeedbackKind.DIRECT, moved, target, rate)
    expected = [f + (p - f) * (1 - rate) ** count for p, f in zip(profile, target, strict=True)]
    assert moved == pytest.approx(expected, abs=1e-12, rel=0)


@given(profiles, targets, st.floats(0.01, 1.0), st.sampled_from(Update), st.integers(1, 40))
def test_constant_feedback_brings_every_update_closer_each_step(
    profile, target, rate, update, count
):
    rule = LearningRule(update=update)
    recent: tuple[Vector, ...] = ()
    for _ in range(count):
        before, profile = (
            profile,
            step(FeedbackKind.DIRECT, profile, target, rate, rule=rule, recent=recent),
        )
        recent = (*recent, target)[-rule.window :]
        for p, q, f in zip(before, profile, target, strict=True):
            assert math.isnan(f) or abs(q - f) <= abs(p - f)


@given(kinds, profiles, targets, rates)
def test_default_rule_equals_paper_formula_bit_for_bit(kind, profile, target, rate):
    def plain(p: float, f: float, low: float, high: float) -> float:
        if math.isnan(f):
            return p
        if kind is FeedbackKind.SET:
            return f
        moved = p - rate * (f - p) if kind is FeedbackKind.NEGATIVE else p + rate * (f - p)
        if kind is not FeedbackKind.NEGATIVE:
            moved = min(max(moved, min(p, f)), max(p, f))
        return min(max(moved, low), high)

    rows = zip(profile, target, RANGES, strict=True)
    expected = tuple(plain(p, f, *ends) for p, f, ends in rows)
    assert step(kind, profile, target, rate) == expected


@given(st.lists(targets, max_size=20))
def test_wrong_share_is_a_share_or_unknown(recent):
    share = learning_step.false_rate(recent, SPACE)
    assert math.isnan(share) == (len(recent) < learning_step.FEWEST_SAMPLES)
    assert math.isnan(share) or 0.0 <= share <= 1.0
