# SPDX-License-Identifier: Apache-2.0
"""Readings: mapped, checked, and never replaced by an invalid one."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.health import Health
from bt_agents_core.source_mapping import inverted, mapped
from bt_agents_language.model.scene_specs import SceneSpec, SourceSpec
from file_texts import read_scene_text
from plain_message import message_of
from scene_layer.health import Standing, sources_health
from scene_layer.sources import Reading, Sources
from scene_layer_harness import number_source
from scene_spaces import AGE_AND_MOOD as SPACE

AGE = number_source("age", (10.0, 1.0), (20.0, 2.0), (80.0, 5.0))
MOOD = number_source("mood")
OTHER_MOOD = number_source("mood", topic="face/mood", line=2)
PERSON = number_source("person")
SPEC = SceneSpec(space=SPACE, sources=(AGE, MOOD, OTHER_MOOD), person=PERSON)


@pytest.fixture
def sources() -> Sources:
    return Sources(SPEC)


@pytest.mark.parametrize(
    ("reading", "value"),
    [(-5.0, 1.0), (10.0, 1.0), (15.0, 1.5), (20.0, 2.0), (50.0, 3.5), (80.0, 5.0), (200.0, 5.0)],
)
def test_reading_is_interpolated_and_held_beyond_map_points(reading, value):
    assert mapped(AGE.points, reading) == value


@pytest.mark.parametrize(("spec", "values"), [(AGE, [1.0, 1.5, 2.0, 3.5, 5.0]), (MOOD, [4.5])])
def test_inverted_value_maps_back_to_itself(spec, values):
    assert [mapped(spec.points, inverted(spec.points, v)) for v in values] == pytest.approx(values)


def test_falling_and_flat_points_can_be_inverted():
    falling = ((0.0, 5.0), (1.0, 3.0), (2.0, 3.0), (3.0, 1.0))
    assert [inverted(falling, v) for v in (5.0, 4.0, 3.0, 2.0, 1.0)] == [0.0, 0.5, 1.0, 2.5, 3.0]
    assert [inverted(AGE.points, v) for v in (0.0, 9.0)] == [10.0, 80.0], "the nearest point"


def read(sources: Sources, spec: SourceSpec, raw: object, now: float, person: str = "") -> bool:
    return sources.read(spec, message_of({"data": raw}), now, person)


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (math.nan, "NOT_FINITE"),
        (math.inf, "NOT_FINITE"),
        (10**400, "NOT_FINITE"),
        ("4", "NOT_A_NUMBER"),
        ([4.0], "NOT_A_NUMBER"),
        (0.5, "OUT_OF_RANGE"),
        (5.5, "OUT_OF_RANGE"),
    ],
)
def test_bad_reading_is_rejected_and_last_good_kept(sources, raw, code):
    read(sources, MOOD, 4.0, 10.0)
    for count in (1, 2):
        with pytest.raises(Refused) as refused:
            read(sources, MOOD, raw, 11.0)
        assert refused.value.code == code
        assert "sensors/mood" in refused.value.reason
        assert sources.refusals == {("sensors/mood", code): count}
    reading = sources.latest("mood", 11.0)
    assert reading is not None
    assert (reading.value, reading.at, reading.stale_at) == (4.0, 10.0, 12.0)


def test_reading_outside_map_is_clamped_but_infinity_rejected(sources):
    read(sources, AGE, 1e300, 0.0)
    assert sources.latest("age", 0.0).value == 5.0
    with pytest.raises(Refused, match="NOT_FINITE"):
        read(sources, AGE, math.inf, 1.0)


def test_fresh_readings_of_several_sources_are_fused(sources):
    read(sources, MOOD, 4.0, 1.0)
    read(sources, OTHER_MOOD, 2.0, 2.0)
    both = sources.latest("mood", 3.0)
    assert (both.value, both.at, both.stale_at) == (3.0, 2.0, 4.0)
    assert both.source == "face/mood and sensors/mood"
    for now in (3.5, 9.0):
        newest = sources.latest("mood", now)
        assert (newest.value, newest.stale_at) == (2.0, 4.0), "it remains when all are stale"
    assert sources.reading(MOOD, 9.0) is None


def test_changed_reading_is_distinguished_from_repetition(sources):
    assert read(sources, MOOD, 4.0, 1.0)
    assert not read(sources, MOOD, 4.0, 2.0)
    assert read(sources, MOOD, 3.0, 3.0)
    assert read(sources, MOOD, 3.0, 9.0), "it had been stale, so it is news again"


def test_boolean_is_read_as_zero_or_one(sources):
    assert (sources.latest("mood", 0.0), sources.latest_person()) == (None, None)
    read(sources, PERSON, True, 1.0)
    assert sources.latest_person().value == 1.0
    read(sources, PERSON, False, 2.0)
    assert sources.latest_person().value == 0.0


# Sources in an author's notation


PERSONS = """
persons:
  tracked: {topic: faces, type: x_msgs/msg/X, field: faces, id: face_id, stale_after: 2 s}
  parts: {face: {topic: "p/<person>/face_id", type: x_msgs/msg/X, field: data, latched: true}}
"""


def written(source: str, above: str = "") -> tuple[Sources, SceneSpec]:
    """Return the sources of a scene whose mood comes from ``source``."""
    text = f"""
format: 1
parameters:
  mood: {{min: 1, max: 5, default: 3}}
{above}
sources:
  mood: {source}
"""
    spec = read_scene_text(text, "scene.yaml")
    return Sources(spec), spec


def topic(field: str, more: str = "", name: str = "face") -> str:
    return (
        f'{{topic: "{name}", type: x_msgs/msg/X, field: "{field}", stale_after: 2 s'
        f"{', ' if more else ''}{more}}}"
    )


def after(source: str, *messages: dict[str, object]) -> Reading | None:
    """Return the values after messages one second apart."""
    sources, spec = written(source)
    for number, fields in enumerate(messages):
        sources.read(spec.sources[0], message_of(fields), float(number))
    return sources.latest("mood", float(len(messages) - 1))


def test_reading_may_be_computed_with_values_for_nan():
    field = "3 + msg.valence * msg.confidence"
    assert after(topic(field), {"valence": 1.0, "confidence": 0.5}).value == 3.5
    source = topic("msg.data else 2", "confidence: msg.sure else 0.5")
    assert after(source, {"data": math.nan, "sure": math.nan}).value == 2.0
    assert after(source, {"data": math.nan, "sure": math.nan}).confidence == 0.5
    assert after(source, {"data": 4.0, "sure": 1.0}).value == 4.0
    for bad in ({"a": math.nan, "b": 1}, {"a": 1, "b": 0}):
        with pytest.raises(Refused, match=r"^NOT_COMPUTABLE"):
            after(topic("msg.a / msg.b"), bad)


def test_table_maps_words_and_rejects_unknown_ones():
    source = topic("emotion", "table: {happy: 5, sad: 1, true: 2, 7: 3}")
    found = [after(source, {"emotion": word}).value for word in ("happy", True, 7, 7.0)]
    assert found == [5.0, 2.0, 3.0, 3.0]
    assert after(source, {"emotion": ""}) is None, "no word is no measurement"
    with pytest.raises(Refused, match=r"^UNKNOWN_WORD: .*'angry', expected one of happy, sad"):
        after(source, {"emotion": "angry"})


def test_empty_list_is_ignored_but_missing_field_rejected():
    source = topic("faces.0.mood")
    assert after(source, {"faces": []}) is None
    with pytest.raises(Refused, match=r"^UNKNOWN_FIELD: .*no field 'faces\.0\.mood'"):
        after(source, {"faces": [{"age": 3}]})


def test_reading_without_confidence_is_no_measurement():
    source = topic("data", "confidence: sure")
    assert after(source, {"data": math.nan, "sure": 0.0}) is None
    assert after(source, {"data": 2.0, "sure": False}) is None
    assert after(source, {"data": 2.0, "sure": 0.25}).confidence == 0.25
    kept = after(source, {"data": 2.0, "sure": 1.0}, {"data": 5.0, "sure": 0.0})
    assert kept.value == 2.0, "the last measurement stays until it is stale"


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        *(
            ("confidence", sure, "0 to 1")
            for sure in (1.01, -0.1, math.nan, math.inf, "high", None)
        ),
        *(("std", doubt, "0 or more") for doubt in (-0.1, math.nan, math.inf, "small", None)),
    ],
)
def test_confidence_or_deviation_out_of_range_is_rejected(option, value, expected):
    with pytest.raises(Refused, match=rf"^OUT_OF_RANGE: .*expected {expected}"):
        after(topic("data", f"{option}: said"), {"data": 2.0, "said": value})


def test_standard_deviation_is_mapped_with_the_reading():
    source = topic("data", "std: 0.5, map: {0: 1, 10: 5}")
    assert after(source, {"data": 5.0}).std == pytest.approx(0.2)
    at_the_end = after(source, {"data": 10.0}).std
    assert at_the_end == pytest.approx(0.2 / math.sqrt(2))
    for beyond in (10.4, 50.0):
        assert after(source, {"data": beyond}).std == at_the_end, "what is held is not exact"
    table = topic("data", "std: 0.5, table: {sad: 1, happy: 5}")
    assert after(table, {"data": "sad"}).std == 0.5, "a table maps no deviation"


def test_standard_deviation_is_bounded_by_that_of_range():
    source = topic("data", "std: 9e99, confidence: 1e-300")
    assert after(source, {"data": 2.0}).std == pytest.approx(4 / math.sqrt(12))


def test_smoothed_reading_lags_and_restarts_after_gap():
    sources, spec = written(topic("data", "smoothing: 1 s"))
    (mood,) = spec.sources
    read(sources, mood, 1.0, 0.0)
    assert read(sources, mood, 5.0, 1.0)
    assert sources.latest("mood", 1.0).value == pytest.approx(5.0 - 4.0 * math.exp(-1.0))
    read(sources, mood, 5.0, 9.0)
    assert sources.latest("mood", 9.0).value == 5.0


def test_impersonal_source_counts_for_every_person():
    each, all_ = topic("data", name="p/<person>/mood"), topic("data", name="room")
    sources, spec = written(f"[{each}, {all_}]", PERSONS)
    read(sources, spec.sources[0], 2.0, 0.0, "anna")
    read(sources, spec.sources[1], 4.0, 0.0)
    assert sources.latest("mood", 1.0, "anna").value == 3.0
    assert sources.latest("mood", 1.0, "anna", alone=True).value == 2.0
    assert sources.latest("mood", 1.0, "ben") is None, "not alone, where others are about one"
    assert sources.latest("mood", 1.0).value == 4.0
    sources.forget("anna")
    assert sources.latest("mood", 1.0).value == 4.0


def test_item_source_reads_item_of_its_person():
    sources, spec = written("{from: tracked, field: msg.happy * 5, confidence: sure}", PERSONS)
    (mood,) = spec.sources
    assert (mood.topic, mood.of_item, mood.stale_after_s) == ("faces", True, 2.0)
    sources.read(mood, message_of({"happy": 0.8, "sure": 0.5}), 0.0, "anna")
    found = sources.latest("mood", 1.0, "anna")
    assert (found.value, found.confidence) == (4.0, 0.5)


def test_topics_exist_for_persons_and_identified_parts():
    sources, spec = written(topic("data", name="faces/<face>/mood"), PERSONS)
    (mood,), (part,) = spec.sources, spec.persons.parts
    people = ("anna", "b/c", "1st", "", "x" * 10_000, "d__e", "ü")
    wanted = {(part, "anna"): "p/anna/face_id"}
    refused_names = {who: name for (_, who), name in sources.topics(people, 0.0).items()}
    assert refused_names == {"anna": "p/anna/face_id"}
    sources.read(part, message_of({"data": " f1 "}), 0.0, "anna")
    assert sources.topics(["anna"], 1e9) == {**wanted, (mood, "anna"): "faces/f1/mood"}
    sources.forget("anna")
    assert sources.topics(["anna"], 1.0) == wanted


def test_place_is_constant_or_read_from_topic():
    sources, spec = written(topic("data"), "place: lobby")
    assert (spec.place, sources.place(0.0)) == ("lobby", "lobby")
    sources, spec = written(topic("data"), f"place: {topic('data', name='where')}")
    assert sources.place(0.0) == ""
    assert read(sources, spec.place, "kitchen", 0.0)
    assert not read(sources, spec.place, "kitchen", 1.0)
    assert sources.place(1.0) == "kitchen"
    assert sources.place(4.0) == "", "it is stale"


@pytest.mark.parametrize(
    ("text", "code"), [("x" * 101, "TOO_LONG"), ("a\nb", "TOO_LONG"), (7, "NOT_A_TEXT")]
)
def test_place_must_be_a_short_text(text, code):
    sources, spec = written(topic("data"), f"place: {topic('data', name='where')}")
    with pytest.raises(Refused, match=f"^{code}:"):
        read(sources, spec.place, text, 0.0)
    assert sources.place(0.0) == ""


def test_topic_standing_goes_from_unread_to_stale(sources):
    assert set(sources.standings(now=0.0).values()) == {Standing.UNREAD}
    sources.read(AGE, message_of({"data": 20.0}), now=1.0)
    assert sources.standings(now=3.0)["sensors/age"] is Standing.FRESH
    assert sources.standings(now=3.0)["sensors/person"] is Standing.UNREAD
    assert sources.standings(now=3.1)["sensors/age"] is Standing.STALE


# Health


@pytest.mark.parametrize(
    ("age", "mood", "level", "words"),
    [
        (Standing.FRESH, Standing.FRESH, Health.OK, "every source has a reading that holds"),
        (Standing.UNREAD, Standing.FRESH, Health.WARN, "no reading so far: /age"),
        (Standing.UNREAD, Standing.STALE, Health.STALE, "stale: /mood"),
    ],
)
def test_health_of_sources_is_that_of_the_worst(age, mood, level, words):
    health = sources_health({"/age": age, "/mood": mood}, {("/age", "OUT_OF_RANGE"): 12}, {})
    assert (health.part, health.level, health.message) == ("sources", level, words)
    assert health.values["/age"] == f"{age.value}, 12 refused as OUT_OF_RANGE"


def test_other_type_of_publisher_is_an_error() -> None:
    types = "std_msgs/msg/Int32, expected std_msgs/msg/Float64"
    health = sources_health({"/age": Standing.STALE}, {}, {"/age": types})
    assert (health.level, health.message) == (Health.ERROR, f"/age is published as {types}")
    assert health.values["/age"] == f"its last reading is stale, published as {types}"
