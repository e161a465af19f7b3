# SPDX-License-Identifier: Apache-2.0
"""One step of learning, by tables."""

from __future__ import annotations

import math

import pytest

from bt_agents.errors import Refused
from bt_agents.scene import SceneParameter, SceneSpace, Vector
from feedback_node import learning

NAN = math.nan
SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0)
        for name in ("age", "familiarity", "mood")
    ),
    mood="mood",
)


@pytest.mark.parametrize(
    ("target", "rate", "after"),
    [
        ((5.0, 4.0, 1.0), 0.2, (3.0, 2.8, 2.2)),
        ((5.0, 4.0, 1.0), 1.0, (5.0, 4.0, 1.0)),
        ((5.0, 4.0, 1.0), 0.0, (2.5, 2.5, 2.5)),
        ((5.0, NAN, NAN), 0.5, (3.75, 2.5, 2.5)),
    ],
)
def test_direct_feedback_moves_by_the_rate_and_leaves_what_has_no_opinion(target, rate, after):
    step = learning.direct((2.5, 2.5, 2.5), target, rate, SPACE)
    assert step.after == pytest.approx(after)


def test_positive_feedback_moves_towards_the_known_values_of_the_scene():
    step = learning.positive((3.0, 3.0, 3.0), (4.0, NAN, 2.0), 0.5, SPACE)
    assert step.after == (3.5, 3.0, 2.5)
    assert step.words == "age 3 → 3.5, mood 3 → 2.5"


def test_negative_feedback_moves_away_by_the_same_step():
    towards = learning.positive((3.0, 3.0, 3.0), (4.0, NAN, 2.0), 0.5, SPACE)
    away = learning.negative((3.0, 3.0, 3.0), (4.0, NAN, 2.0), 0.5, SPACE)
    assert away.after == (2.5, 3.0, 3.5)
    assert [a - 3.0 for a in away.after] == [3.0 - t for t in towards.after]


def test_negative_feedback_stops_at_the_edge_of_the_range():
    step = learning.negative((4.9, 1.2, 3.0), (1.0, 5.0, 3.0), 1.0, SPACE)
    assert step.after == (5.0, 1.0, 3.0)


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (
            learning.negative((3.0, 2.0, 4.0), (3.0, NAN, 4.0), 0.5, SPACE),
            "no direction leads away",
        ),
        (learning.positive((3.0, 2.0, 4.0), (3.0, NAN, 4.0), 0.5, SPACE), "it is there already"),
        (learning.direct((3.0, 2.0, 4.0), (5.0, 5.0, 5.0), 0.0, SPACE), "the learning rate is 0"),
        (learning.negative((5.0, 5.0, 5.0), (1.0, 1.0, 1.0), 0.5, SPACE), "at the edge"),
    ],
)
def test_a_profile_that_stays_says_why(step, words):
    assert step.after == step.before
    assert words in step.words


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
def test_a_vector_that_is_no_feedback_is_refused(code, target):
    with pytest.raises(Refused) as refusal:
        learning.direct((3.0, 3.0, 3.0), target, 0.2, SPACE)
    assert refusal.value.code == code


@pytest.mark.parametrize("rule", [learning.positive, learning.negative])
def test_a_scene_without_any_known_value_teaches_nothing(rule):
    with pytest.raises(Refused) as refusal:
        rule((3.0, 3.0, 3.0), (NAN, NAN, NAN), 0.2, SPACE)
    assert refusal.value.code == "NO_SCENE"


@pytest.mark.parametrize("rate", [-0.1, 1.1, NAN, math.inf])
def test_a_rate_outside_0_to_1_is_refused(rate):
    with pytest.raises(Refused) as refusal:
        learning.direct((3.0, 3.0, 3.0), (4.0, 4.0, 4.0), rate, SPACE)
    assert refusal.value.code == "BAD_RATE"


@pytest.mark.parametrize(("rate", "cycles"), [(0.05, 92), (0.2, 22), (0.5, 7)])
def test_the_first_experiment_of_the_paper_converges_in_the_known_number_of_cycles(rate, cycles):
    goal: Vector = (5.0, 4.0, 1.0)
    profile: Vector = (2.5, 2.5, 2.5)
    count = 0
    while sum(abs(g - p) for g, p in zip(goal, profile, strict=True)) >= 0.05:
        profile = learning.direct(profile, goal, rate, SPACE).after
        count += 1
    assert count == cycles
