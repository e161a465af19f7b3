# SPDX-License-Identifier: Apache-2.0
"""Laws of sources: they read a valid value from any message, or refuse it with a code."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_agents_core.errors import Refused
from file_texts import read_scene_text
from plain_message import message_of
from scene_layer.sources import Reading, Sources, fused, smoothed

SCENE = """
format: 1
place: {topic: d, type: x_msgs/msg/X, field: data, latched: true}
parameters:
  age: {min: 1, max: 5, default: 3}
  mood: {min: -1, max: 1, default: 0}
persons:
  tracked: {topic: t, type: x_msgs/msg/X, field: data, id: data, stale_after: 2 s}
  parts: {face: {topic: p/<person>/f, type: x_msgs/msg/X, field: data, latched: true}}
  known: {from: tracked, field: data}
  addressee: {rule: nearest, source: {from: tracked, field: data, smoothing: 1 s}}
sources:
  age: {topic: a, type: x_msgs/msg/X, field: data, confidence: sure, std: doubt, smoothing: 1 s,
        map: {0: 1, 80: 5}, stale_after: 2 s}
  mood:
    - {topic: b, type: x_msgs/msg/X, field: data, table: {sad: -1, true: 0, 7: 1}, std: doubt,
       stale_after: 2 s}
    - {topic: <face>/c, type: x_msgs/msg/X, field: msg.data / msg.sure - 1, stale_after: 2 s}
"""
SPEC = read_scene_text(SCENE, "scene.yaml")
ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.just(10**400)
    | st.floats()
    | st.floats(0.0, 1.0)
    | st.text(max_size=8)
    | st.sampled_from(["sad", "x" * 10_000, "anna", "\0"]),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=3,
)
MESSAGES = st.dictionaries(st.sampled_from(["data", "sure", "doubt"]), ANYTHING)


@given(st.lists(st.tuples(st.sampled_from(SPEC.every_source), MESSAGES), max_size=8))
def test_any_message_is_read_or_rejected_with_code(messages):
    sources = Sources(SPEC)
    refused: list[Refused] = []
    for number, (source, fields) in enumerate(messages):
        try:
            sources.read(source, message_of(fields), number * 0.7, "anna")
        except Refused as problem:
            refused.append(problem)
    assert sum(sources.refusals.values()) == len(refused)
    assert all(problem.code and len(problem.reason) < 1000 for problem in refused)
    for parameter in SPEC.space.parameters:
        reading = sources.latest(parameter.name, len(messages) * 0.7, "anna")
        if reading is not None:
            assert parameter.minimum <= reading.value <= parameter.maximum
            assert 0.0 <= reading.std < math.inf
            assert 0.0 < reading.confidence <= 1.0
    assert len(sources.place(1e9)) <= 100
    for topic in sources.topics(["anna", "a/b", "x" * 300], 1e9).values():
        assert "<" not in topic


@pytest.mark.parametrize("forget", [Sources.forget, lambda sources, person: None])
@given(people=st.lists(st.sampled_from(["anna", "ben", "a/b"]), max_size=6))
def test_readings_of_one_person_do_not_affect_another(
    forget: Callable[[Sources, str], None], people: list[str]
) -> None:
    sources = Sources(SPEC)
    of_person = SPEC.sources[-1]
    for number, person in enumerate(people):
        sources.read(of_person, message_of({"data": 1.0, "sure": 1.0}), float(number), person)
    forget(sources, "ben")
    known = {"ben"} if forget is not Sources.forget else set()
    for person in ("anna", "ben", "a/b"):
        found = sources.latest("mood", float(len(people)), person) is not None
        assert found == (person in people and (person != "ben" or "ben" in known))


# Fused and smoothed readings
VALUES = st.floats(-1e6, 1e6)
STDS = st.just(0.0) | st.floats(1e-9, 1e9)
CONFIDENCES = st.floats(1e-6, 1.0)
READINGS = st.builds(
    Reading,
    value=VALUES,
    at=st.floats(0.0, 1e6),
    stale_at=st.floats(0.0, 1e6),
    std=STDS,
    confidence=CONFIDENCES,
    source=st.sampled_from(["", "camera", "audio", "floor"]),
)
MANY = st.lists(READINGS, min_size=1, max_size=6)


@given(MANY)
def test_fused_value_lies_between_its_inputs(readings):
    values = [reading.value for reading in readings]
    assert min(values) <= fused(readings).value <= max(values)


@given(MANY, READINGS)
def test_another_reading_never_reduces_certainty(readings, more):
    before, after = fused(readings), fused([*readings, more])
    assert after.confidence >= before.confidence
    if before.std > 0.0:
        assert 0.0 < after.std <= before.std * (1.0 + 1e-12)


@given(READINGS, st.integers(1, 6))
def test_equal_readings_fuse_to_their_value(reading, count):
    result = fused([reading] * count)
    assert result.value == reading.value
    expected = reading.std / math.sqrt(count * reading.confidence)
    assert result.std == pytest.approx(expected, rel=1e-12)


@given(READINGS)
def test_single_certain_reading_stays_unchanged(reading):
    sure = replace(reading, confidence=1.0)
    assert fused([sure]) == sure


@given(st.data(), MANY)
def test_order_of_readings_does_not_matter(data, readings):
    assert fused(data.draw(st.permutations(readings))) == fused(readings)


@given(VALUES, VALUES, st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_two_certain_readings_fuse_by_inverse_variance(a, b, s, t):
    result = fused([Reading(value=a, at=0.0, std=s), Reading(value=b, at=0.0, std=t)])
    p, q = 1.0 / s**2, 1.0 / t**2
    assert result.value == pytest.approx((p * a + q * b) / (p + q), rel=1e-9, abs=1e-3)
    assert result.std == pytest.approx(1.0 / math.sqrt(p + q), rel=1e-9)


@given(VALUES, VALUES, CONFIDENCES, CONFIDENCES)
def test_confidences_are_the_weights_without_deviations(a, b, c, d):
    result = fused(
        [Reading(value=a, at=0.0, confidence=c), Reading(value=b, at=0.0, confidence=d)]
    )
    assert result.value == pytest.approx((c * a + d * b) / (c + d), rel=1e-9, abs=1e-3)
    assert (result.std, result.confidence) == (0.0, max(c, d))


@given(READINGS, READINGS, st.floats(0.0, 100.0))
def test_smoothed_reading_lies_between_old_and_new(before, new, seconds):
    result = smoothed(before, new, seconds)
    for name in ("value", "std", "confidence"):
        low, high = sorted((getattr(before, name), getattr(new, name)))
        assert low <= getattr(result, name) <= high
    assert (result.at, result.stale_at) == (new.at, new.stale_at)


@given(VALUES, VALUES, CONFIDENCES, st.floats(0.1, 10.0), st.integers(1, 20))
def test_smoothing_depends_on_time_not_on_steps(start, end, sure, tau, steps):
    """However many steps divide the time, the remaining difference is exp(−c·t/τ) of it."""
    now = Reading(value=start, at=0.0)
    for number in range(1, steps + 1):
        at = tau * number / steps
        now = smoothed(now, Reading(value=end, at=at, confidence=sure), tau)
    left = (start - end) * math.exp(-sure)
    assert now.value - end == pytest.approx(left, rel=1e-9, abs=1e-6)


@given(READINGS, READINGS)
def test_smoothing_needs_time_constant_and_fresh_reading(before, new):
    assert smoothed(before, new, 0.0) == new
    assert smoothed(replace(before, stale_at=new.at - 1.0), new, 5.0) == new
