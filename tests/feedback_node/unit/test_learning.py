# SPDX-License-Identifier: Apache-2.0
"""One learning step, in tables."""

from __future__ import annotations

import math
from functools import partial

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.scene import SceneParameter, SceneSpace, Vector
from feedback_node.learning.learning_step import false_rate, parameter_rules, requested, step

NAN = math.nan
MIDDLE: Vector = (3.0, 3.0, 3.0)
SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0)
        for name in ("age", "familiarity", "mood")
    ),
    mood="mood",
)


AWAY = LearningRule(retreat={"age": 1.0})
MEDIAN = LearningRule(update=Update.MEDIAN)

direct = partial(step, FeedbackKind.DIRECT, space=SPACE)
positive = partial(step, FeedbackKind.POSITIVE, space=SPACE)
negative = partial(step, FeedbackKind.NEGATIVE, space=SPACE)


def test_positive_feedback_moves_towards_known_scene_values():
    made = positive(MIDDLE, (4.0, NAN, 2.0), rate=0.5)
    assert made.after == (3.5, 3.0, 2.5)
    assert made.text == "age 3 → 3.5, mood 3 → 2.5"


@pytest.mark.parametrize(
    ("profile", "after"),
    [
        (MIDDLE, (2.0, 3.0, 3.0)),
        # So close to the scene, on either side, that the displayed numbers are equal.
        ((3.003, 3.0, 3.0), (2.0015, 3.0, 3.0)),
        ((2.997, 3.0, 3.0), (1.9985, 3.0, 3.0)),
        # Farther away, the paper's formula holds, whatever the file says.
        ((3.2, 3.0, 3.0), (3.3, 3.0, 3.0)),
    ],
)
def test_negative_feedback_on_exact_scene_moves_to_retreat(profile, after):
    made = negative(profile, MIDDLE, rate=0.5, rule=AWAY)
    assert made.after == pytest.approx(after)


def test_retreat_is_bounded_like_any_step():
    far = {"age": 1.0}
    bounded = LearningRule(retreat=far, drift={"age": 0.25})
    clipped = LearningRule(retreat=far, update=Update.HUBER, width={"age": 0.5})
    frozen = LearningRule(retreat=far, rates={"age": 0.0})
    on_scene = partial(negative, MIDDLE, (3.0, NAN, NAN), rate=0.5)
    assert on_scene(rule=bounded, authored=MIDDLE).after[0] == 2.75
    assert on_scene(rule=clipped).after[0] == 2.75
    assert on_scene(rule=frozen).after[0] == 3.0
    assert on_scene(rule=AWAY, weight=0.5).after[0] == 2.5


def test_median_counts_retreat_as_one_feedback():
    rule = LearningRule(update=Update.MEDIAN, retreat={"age": 1.0})
    recent = ((2.0, NAN, NAN), (4.0, NAN, NAN))
    made = negative(MIDDLE, (3.0, NAN, NAN), rate=0.5, rule=rule, recent=recent)
    assert made.after[0] == 2.5


FROZEN, BOUNDED = LearningRule(rates={"age": 0.0}), LearningRule(drift={"age": 1.0})
AGE: Vector = (5.0, NAN, NAN)


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (
            negative((3.0, 2.0, 4.0), (3.0, NAN, 4.0), rate=0.5),
            "'retreat' under 'learning' in its file declares where to, for age and mood",
        ),
        (
            negative((1.0, 2.0, 4.0), (1.0, NAN, NAN), rate=0.5, rule=AWAY),
            "it has retreated as far as its file says",
        ),
        (positive((3.0, 2.0, 4.0), (3.0, NAN, 4.0), rate=0.5), "it is there already"),
        (direct((3.0, 2.0, 4.0), (5.0, 5.0, 5.0), rate=0.0), "the learning rate is 0"),
        (negative((5.0, 5.0, 5.0), (1.0, 1.0, 1.0), rate=0.5), "at the edge"),
        (direct(MIDDLE, AGE, rate=0.5, rule=FROZEN), "the learning rate is 0"),
        (direct(MIDDLE, AGE, rate=0.5, weight=0.0), "the learning rate is 0"),
        (
            direct((4.0, 2.0, 4.0), AGE, rate=0.5, rule=BOUNDED, authored=MIDDLE),
            "may not get farther from its file",
        ),
        (
            direct(MIDDLE, AGE, rate=0.5, rule=MEDIAN, recent=(MIDDLE,) * 4),
            "where most of the last feedbacks want it",
        ),
    ],
)
def test_unchanged_profile_states_reason(made, text):
    assert made.after == made.before
    assert text in made.text


@pytest.mark.parametrize(
    ("code", "target"),
    [
        ("NO_OPINION", (NAN, NAN, NAN)),
        ("NOT_FINITE", (math.inf, 3.0, 3.0)),
        ("NOT_FINITE", (3.0, -math.inf, 3.0)),
        ("OUT_OF_RANGE", (3.0, 3.0, 5.1)),
        ("WRONG_LENGTH", (3.0, 3.0)),
        ("WRONG_LENGTH", ()),
    ],
)
def test_invalid_feedback_vector_is_rejected(code, target):
    with pytest.raises(Refused, match=f"^{code}:"):
        direct(MIDDLE, target, rate=0.2)


@pytest.mark.parametrize("feedback", [positive, negative])
def test_scene_without_known_values_teaches_nothing(feedback):
    with pytest.raises(Refused, match=r"^NO_SCENE:"):
        feedback(MIDDLE, (NAN, NAN, NAN), rate=0.2)


@pytest.mark.parametrize(
    ("rate", "weight"),
    [(-0.1, 1.0), (1.1, 1.0), (NAN, 1.0), (0.2, -0.1), (0.2, NAN), (0.2, math.inf)],
)
def test_rate_or_weight_out_of_range_is_rejected(rate, weight):
    with pytest.raises(Refused, match=r"^OUT_OF_RANGE:"):
        direct(MIDDLE, (4.0, 4.0, 4.0), rate=rate, weight=weight)


# --- rates, weights and bounds --------------------------------------------------------------


def test_parameter_may_have_own_rate_or_be_frozen():
    rule = LearningRule(rates={"age": 0.5, "mood": 0.0})
    made = direct(MIDDLE, (5.0, 5.0, 5.0), rate=0.1, rule=rule)
    assert made.after == (4.0, 3.2, 3.0)
    assert made.rates == (0.5, 0.1, 0.0)


@pytest.mark.parametrize(
    ("weight", "after"), [(0.0, 3.0), (0.5, 3.2), (1.0, 3.4), (3.0, 4.2), (50.0, 5.0)]
)
def test_source_weight_scales_step_up_to_full_distance(weight, after):
    made = direct(MIDDLE, (5.0, NAN, NAN), rate=0.2, weight=weight)
    assert made.after[0] == pytest.approx(after)


@pytest.mark.parametrize(("changes", "rate"), [(0, 0.4), (1, 0.2), (9, 0.04)])
def test_annealed_rate_falls_with_number_of_changes(changes, rate):
    rule = LearningRule(anneal=1.0)
    made = direct(MIDDLE, AGE, rate=0.4, rule=rule, changes=changes)
    assert made.rates[0] == pytest.approx(rate)
    assert made.after[0] == pytest.approx(3.0 + 2.0 * rate)


@pytest.mark.parametrize(
    ("before", "target", "after"),
    [
        (3.0, 5.0, 3.5),
        (3.0, 1.0, 2.5),
        (3.0, 3.2, 3.2),
        # A profile that was tuned out of the bound comes back, and goes no farther.
        (4.5, 5.0, 4.5),
        (4.5, 1.0, 2.5),
    ],
)
def test_drift_limit_bounds_distance_from_authored_profile(before, target, after):
    bounds = {"rule": LearningRule(drift={"age": 0.5}), "authored": MIDDLE}
    made = direct((before, 3.0, 3.0), (target, NAN, NAN), rate=1.0, **bounds)
    assert made.after == (after, 3.0, 3.0)


def test_set_feedback_ignores_the_learning_rule():
    rule = LearningRule(rates={"age": 0.0}, update=Update.MEDIAN, anneal=9.0, drift={"age": 0.1})
    evidence = {"recent": ((1.0, 1.0, 1.0),) * 9, "changes": 9, "authored": MIDDLE, "weight": 0.0}
    made = step(FeedbackKind.SET, MIDDLE, AGE, rate=0.0, space=SPACE, rule=rule, **evidence)
    assert (made.after, made.rate, made.weight) == ((5.0, 3.0, 3.0), 1.0, 1.0)


# --- wrong feedback -----------------------------------------------------------------------


def taught(rule: LearningRule, count: int, wrong_every: int) -> list[Vector]:
    """Return the profiles of the paper's Experiment 2, in which wrong feedback is 5 everywhere."""
    profile: Vector = (2.5, 2.5, 2.5)
    recent: list[Vector] = []
    profiles = []
    for number in range(1, count + 1):
        wrong = number % wrong_every == 0
        target: Vector = (5.0, 5.0, 5.0) if wrong else (5.0, 4.0, 1.0)
        last = tuple(recent[-rule.window :])
        profile = direct(profile, target, rate=0.2, rule=rule, recent=last).after
        recent.append(target)
        profiles.append(profile)
    return profiles


NARROW = dict.fromkeys(SPACE.names, 0.25)


@pytest.mark.parametrize(
    ("rule", "count", "near"),
    [
        (LearningRule(update=Update.HUBER), 16, 0.7),
        (LearningRule(update=Update.HUBER, width=NARROW), 79, 0.2),
        (LearningRule(update=Update.MEDIAN), 12, 0.2),
    ],
)
def test_robust_update_converges_despite_one_third_wrong_feedback(rule, count, near):
    far = [
        max(abs(a - b) for a, b in zip(profile, (5.0, 4.0, 1.0), strict=True))
        for profile in taught(rule, 300, 3)
    ]
    assert max(far[count - 1 :]) <= near
    assert far[count - 2] > near


def test_huber_step_is_bounded_by_its_width():
    rule = LearningRule(update=Update.HUBER, width={"age": 1.0})
    made = direct((2.0, 2.0, 2.0), (5.0, 2.1, 5.0), rate=0.5, rule=rule)
    # The default width is a quarter of the range.
    assert made.after == pytest.approx((2.5, 2.05, 2.5))


def test_median_covers_window_of_feedback_including_newest():
    recent = ((1.0, NAN, NAN), (2.0, NAN, NAN), (4.0, NAN, NAN), (5.0, NAN, NAN))
    rules = [LearningRule(update=Update.MEDIAN, window=window) for window in (1, 2, 3, 4, 5, 9)]
    wanted = partial(direct, MIDDLE, (4.5, 5.0, NAN), rate=1.0, recent=recent)
    made = [wanted(rule=rule).after for rule in rules]
    assert [one[0] for one in made] == [4.5, 4.75, 4.5, 4.25, 4.0, 4.0]
    assert {one[1:] for one in made} == {(5.0, 3.0)}


@pytest.mark.parametrize(
    ("kind", "scene", "rule", "target"),
    [
        (FeedbackKind.NEGATIVE, (4.0, NAN, 1.0), LearningRule(), (2.0, NAN, 5.0)),
        (FeedbackKind.POSITIVE, (4.0, 2.0, 1.0), LearningRule(), (4.0, 2.0, 1.0)),
        (FeedbackKind.NEGATIVE, (3.0, 3.0, 1.0), AWAY, (1.0, 3.0, 5.0)),
        (FeedbackKind.POSITIVE, (3.0, 3.0, 1.0), AWAY, (3.0, 3.0, 1.0)),
    ],
)
def test_negative_feedback_targets_mirror_image_or_retreat(kind, scene, rule, target):
    asked = requested(parameter_rules(rule, SPACE), kind, MIDDLE, scene)
    assert asked == pytest.approx(target, nan_ok=True)


def test_single_wrong_negative_does_not_move_positive_median():
    recent = ((4.0, 3.0, 3.0), (4.2, 3.0, 3.0), (3.8, 3.0, 3.0))
    made = negative((3.5, 3.0, 3.0), (4.0, NAN, NAN), rate=0.5, rule=MEDIAN, recent=recent)
    assert made.after[0] == pytest.approx(3.7)


@pytest.mark.parametrize(("wrong", "expected"), [(0, 0.0), (2, 0.2), (3, 0.3), (4, 0.4)])
def test_share_of_wrong_feedback_is_estimated(wrong, expected):
    right = [(4.0 + 0.02 * number, 2.0, NAN) for number in range(10 - wrong)]
    assert false_rate([*right, *[(1.0, 5.0, 3.0)] * wrong], SPACE) == pytest.approx(expected)


def test_slightly_varying_feedback_is_not_wrong():
    spread = [(3.0 + (number % 5) / 10, 3.0 - (number % 3) / 10, NAN) for number in range(30)]
    assert false_rate(spread, SPACE) == 0.0
