# SPDX-License-Identifier: Apache-2.0
"""scene.yaml: its parameters and sources as specs."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_language.files.scene_reader import read_scene
from fake_interfaces import FakeInterfaces
from file_texts import read_scene_text
from tree_harness import TREES

TEXT = """\
format: 1
parameters:
  age: {min: 1, max: 5, default: 3, description: how old, labels: {1: a child, 4.5: old}}
  mood: {min: -1, max: 1, default: 0}
mood: mood
sources:
  person: {topic: p, type: known_msgs/msg/X, field: good, stale_after: 2 s}
  age: {topic: /a, type: known_msgs/msg/X, field: good, map: {80: 5, 5: 1}, stale_after: 1 min}
"""


def test_a_scene_becomes_a_space_and_sources():
    spec = read_scene_text(TEXT, "scene.yaml", FakeInterfaces())
    age, mood = spec.space.parameters
    assert (age.name, age.minimum, age.maximum, age.default) == ("age", 1.0, 5.0, 3.0)
    assert (age.description, age.labels) == ("how old", {1.0: "a child", 4.5: "old"})
    assert (mood.minimum, spec.space.mood) == (-1.0, "mood")
    (source,) = spec.sources
    assert (source.parameter, source.topic, source.path) == ("age", "/a", "good")
    assert (source.points, source.stale_after_s) == (((5.0, 1.0), (80.0, 5.0)), 60.0)
    assert (spec.person.parameter, spec.person.points) == ("person", ())


def test_shipped_scene_has_source_for_every_parameter():
    spec = read_scene(TREES / "scene.yaml")
    assert {source.parameter for source in spec.sources} == set(spec.space.names)
    assert spec.person is not None


def test_sources_and_mood_are_optional():
    spec = read_scene_text("format: 1\nparameters: {a: {min: 0, max: 1, default: 0}}", "s.yaml")
    assert (spec.sources, spec.person, spec.space.mood) == ((), None, None)


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("good, stale_after: 2 s", "bad, stale_after: 2 s", "7:53: error[unknown-ros-field]"),
        ("p, type: known_msgs", "p, type: other", "7:28: error[unknown-ros-type]"),
        ("good, stale_after: 2 s", "a b, stale_after: 2 s", "7:55: error[bad-expression]"),
    ],
)
def test_errors_are_reported_with_position(old, new, error):
    assert old in TEXT
    with pytest.raises(ReadError) as found:
        read_scene_text(TEXT.replace(old, new), "s.yaml", FakeInterfaces())
    assert [line.split("]: ")[0] + "]" for line in found.value.lines] == [f"s.yaml:{error}"]
