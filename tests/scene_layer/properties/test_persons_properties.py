# SPDX-License-Identifier: Apache-2.0
"""Laws of the addressee and of memory, over random crowds and readings."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.model.scene_specs import AddresseeRule
from scene_layer.memory import Memory, Running, from_text, to_text
from scene_layer.persons import NOBODY
from scene_layer_harness import persons_of

HOLD_S = 1.0
IDS = ("a", "b", "c")
AGE = SceneParameter(name="age", minimum=1.0, maximum=5.0, default=3.0)
SPACE = SceneSpace(parameters=(AGE,))


Moment = tuple[float, list[str] | None, dict[str, float]]
"""Time since the last one [s], a tracker's report after it, and the ranks of the persons then."""

numbers = st.floats(0.0, 1.0) | st.just(math.nan)
moments = st.tuples(
    st.floats(0.01, 0.7),
    st.none() | st.lists(st.sampled_from(IDS), unique=True),
    st.dictionaries(st.sampled_from(IDS), numbers),
)
crowds = st.lists(moments, max_size=60)
rules = st.sampled_from(AddresseeRule)


def play(rule: AddresseeRule, crowd: list[Moment]) -> list[tuple[float, str, tuple[str, ...]]]:
    """Return time, addressee and tracked persons after each moment."""
    persons, now, told = persons_of(rule), 0.0, []
    for after_s, listed, ranks in crowd:
        now += after_s
        if listed is not None:
            persons.receive_ids(listed, now)
        persons.update(ranks, now)
        told.append((now, persons.addressee, persons.tracked))
    return told


@given(rules, crowds)
def test_addressee_is_a_tracked_person_or_none(rule, crowd):
    for _, addressee, tracked in play(rule, crowd):
        assert addressee in (NOBODY, *tracked)


@given(rules, crowds)
def test_addressee_switches_are_hold_time_apart(rule, crowd):
    chosen_at, last, before = -math.inf, NOBODY, NOBODY
    for now, addressee, _ in play(rule, crowd):
        if addressee not in (NOBODY, before):
            assert addressee == last or now - chosen_at >= HOLD_S - 1e-9
            chosen_at, last = now, addressee
        before = addressee


@given(rules, crowds)
def test_tracked_addressee_without_better_rival_is_kept(rule, crowd):
    before = NOBODY
    even = [(after_s, listed, dict.fromkeys(IDS, 0.5)) for after_s, listed, _ in crowd]
    for _, addressee, tracked in play(rule, even):
        assert addressee == before or before not in tracked
        before = addressee


@given(rules, crowds)
def test_same_history_chooses_the_same_addressee(rule, crowd):
    assert play(rule, crowd) == play(rule, crowd)


values = st.floats(1.0, 5.0)
samples = st.lists(st.tuples(values, st.floats(0.0, 2.0), st.floats(0.01, 1.0)), min_size=1)


@given(samples)
def test_estimate_lies_between_measurements(measured):
    running = Running()
    for number, (value, std, weight) in enumerate(measured):
        running = running.after(value, std, weight, float(number))
    low, high = min(v for v, _, _ in measured), max(v for v, _, _ in measured)
    assert low - 1e-9 <= running.mean <= high + 1e-9
    assert running.scatter >= 0.0


@given(samples, st.floats(0.0, 1e6), st.floats(0.0, 1e6))
def test_estimate_uncertainty_never_falls_with_age(measured, age_s, more_s):
    running = Running()
    for value, std, weight in measured:
        running = running.after(value, std, weight, 0.0)
    young, old = (running.std(AGE.ignorance, age) for age in (age_s, age_s + more_s))
    assert 0.0 < young <= old + 1e-12


@given(values, st.integers(1, 500))
def test_equal_measurements_are_estimated_exactly(value, count):
    running = Running()
    for _ in range(count):
        running = running.after(value, 0.0, 1.0, 0.0)
    assert abs(running.mean - value) < 1e-9
    assert running.std(AGE.ignorance, 0.0) <= AGE.ignorance / math.sqrt(running.weight + 1) + 1e-9


names = st.text(min_size=1, max_size=20)


@given(st.dictionaries(names, samples, max_size=5), names)
def test_stored_memory_is_restored_exactly(people, place):
    memory = Memory(SPACE)
    for person, measured in people.items():
        memory.came(person, 0.0)
        for number, (value, std, weight) in enumerate(measured):
            memory.measured(person, "age", value, std, weight, float(number))
        memory.left(person, place, known=True, now=100.0)
    text = to_text(*memory.snapshot())
    again = Memory(SPACE)
    again.restore(*from_text(text, SPACE, 100.0))
    assert to_text(*again.snapshot()) == text
    for person in (*people, "a stranger"):
        found = memory.estimate(person, place, "age", 200.0)
        assert again.estimate(person, place, "age", 200.0) == found
