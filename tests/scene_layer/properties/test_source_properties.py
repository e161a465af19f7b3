# SPDX-License-Identifier: Apache-2.0
"""Laws of sources: they read a valid value from any message, or refuse it with a code."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_agents_core.errors import Refused
from file_texts import read_scene_text
from plain_message import message_of
from scene_layer.sources import Sources

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
