# SPDX-License-Identifier: Apache-2.0
"""Laws of simulated runs: closed form, reactions as seen by mood rules, intervals, errors."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents_core.feedback import FeedbackKind
from bt_agents_lab.experiments.measures import wilson
from bt_agents_lab.experiments.random_streams import draw
from bt_agents_lab.experiments.simulated_world import Arm, Person, SimulatedWorld
from bt_agents_lab.experiments.simulation import simulate
from bt_agents_language.model.experiment import FeedbackErrors, PreparedFeedback, closed_form
from feedback_node.simulated_feedback import SimulatedFeedback
from one_run import react
from scene_spaces import AGE_AND_MOOD as SPACE

VALUES = st.floats(1.0, 5.0)
VECTORS = st.tuples(VALUES, VALUES)
SHORT = settings(max_examples=60, deadline=None)


def world(start, best, rate: float, person: Person | None = None) -> SimulatedWorld:
    """One agent, and one scene."""
    return SimulatedWorld(
        space=SPACE,
        agents=("one",),
        starts=np.array([start]),
        best=np.array([best]),
        scenes=np.array([[3.0, 3.0]]),
        rates=np.array([rate]),
        person=person,
    )


@SHORT
@given(start=VECTORS, best=VECTORS, rate=st.floats(0.0, 1.0), cycles=st.integers(1, 40))
def test_profile_under_constant_feedback_follows_closed_form(start, best, rate, cycles):
    one = world(start, best, rate)
    course = simulate(one, Arm(), draw(one, [0], cycles))
    expected = closed_form(start, best, rate, cycles)
    assert np.allclose(course.profiles[0, -1, 0], expected, rtol=0, atol=1e-12)


@SHORT
@given(
    noise=st.lists(st.floats(-3.0, 3.0, width=32), min_size=1, max_size=12),
    fit=st.floats(-1.0, 1.0),
    hold=st.integers(0, 4),
    better=st.floats(0.1, 1.5),
    worse=st.floats(0.1, 1.5),
)
def test_simulated_reactions_match_mood_rules(noise, fit, hold, better, worse):
    person = Person(
        seconds=len(noise), noise=0.5, drift=0.4, better=better, worse=worse, hold_s=hold
    )
    one = world((2.0, 2.0), (3.0, 3.0), 0.5, person)
    streams = replace(
        draw(one, [0], 1),
        error_draw=np.zeros((1, 1, 1)),
        wrong_fit=np.full((1, 1, 1), fit),
        mood_noise=np.array(noise, dtype=np.float32).reshape(1, 1, 1, -1),
    )
    course = simulate(one, Arm(), streams, wrong_share=1.0)
    fired, _ = react(person, SPACE, (3.0, 3.0), fit, [float(value) for value in noise])
    assert course.cancelled[0, 0] == (FeedbackKind.NEGATIVE in fired)
    # A mood rule counts half, so the step is a quarter of the way to the scene or away from it.
    profile = 2.0
    for kind in fired:
        profile += 0.25 * (3.0 - profile) * (1.0 if kind is FeedbackKind.POSITIVE else -1.0)
    expected = min(max(profile, 1.0), 5.0)
    assert np.allclose(course.profiles[0, 0, 0], expected, rtol=0, atol=1e-12)


@given(runs=st.integers(1, 5000), part=st.floats(0.0, 1.0))
def test_interval_contains_share_and_narrows_with_runs(runs, part):
    hits = round(part * runs)
    found, more = wilson(hits, runs), wilson(4 * hits, 4 * runs)
    assert 0.0 <= found.low <= found.share <= found.high <= 1.0
    assert more.high - more.low < found.high - found.low
    turned = wilson(runs - hits, runs)
    assert np.isclose(turned.low, 1.0 - found.high)


@given(
    seed=st.integers(0, 2**31),
    given_before=st.integers(0, 30),
    every=st.integers(0, 4),
    share=st.floats(0.0, 1.0),
)
def test_wrong_feedback_depends_only_on_its_number(seed, given_before, every, share):
    errors = FeedbackErrors(space=SPACE, seed=seed, every=every, share=share)

    def feedback() -> SimulatedFeedback:
        return SimulatedFeedback(PreparedFeedback(each={"one": (5.0, 5.0)}, errors=errors))

    whole, rest = feedback(), feedback()
    said = [whole.next("one") for _ in range(given_before + 10)]
    rest.resume({"one": given_before})
    assert [rest.next("one") for _ in range(10)] == said[given_before:]
    assert all(1.0 <= value <= 5.0 for vector in said if vector for value in vector)
    if every:
        wrong = [errors.instead(index) is not None for index in range(12)]
        assert wrong == [(index + 1) % every == 0 for index in range(12)]


ROWS = st.lists(VECTORS, min_size=1, max_size=4).map(tuple)


@given(
    prepared=st.builds(
        PreparedFeedback,
        each=st.dictionaries(st.just("fixed"), VECTORS),
        sequences=st.dictionaries(st.sampled_from(("one", "two")), ROWS),
        sequence=ROWS | st.just(()),
        repeat=st.booleans(),
    ),
    before=st.lists(st.sampled_from(("fixed", "one", "two", "three")), max_size=20),
    after=st.lists(st.sampled_from(("fixed", "one", "two", "three")), max_size=20),
)
def test_restart_keeps_position_in_every_list(prepared, before, after):
    whole, rest = SimulatedFeedback(prepared), SimulatedFeedback(prepared)
    given = Counter(agent for agent in before if whole.next(agent) is not None)
    rest.resume(given)
    assert [rest.next(agent) for agent in after] == [whole.next(agent) for agent in after]
