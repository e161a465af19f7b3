# SPDX-License-Identifier: Apache-2.0
"""Readings: mapped, checked, and never replaced by an invalid one."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.diagnostic import Position
from bt_agents_core.errors import Refused
from bt_agents_core.source_mapping import inverted, mapped
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.model.scene_specs import SceneSpec, SourceSpec
from file_texts import read_scene_text
from plain_message import message_of
from scene_layer.fusion import Reading
from scene_layer.health import Standing
from scene_layer.sources import Sources
from scene_spaces import AGE_AND_MOOD as SPACE


def source(
    parameter: str, *points: tuple[float, float], topic: str = "", line: int = 1
) -> SourceSpec:
    return SourceSpec(
        parameter=parameter,
        topic=topic or f"sensors/{parameter}",
        type="std_msgs/msg/Float64",
        field=parse_expression("msg.data"),
        points=points,
        stale_after_s=2.0,
        position=Position(file="scene.yaml", line=line, column=1),
    )


AGE = source("age", (10.0, 1.0), (20.0, 2.0), (80.0, 5.0))
MOOD = source("mood")
OTHER_MOOD = source("mood", topic="face/mood", line=2)
PERSON = source("person")
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


@pytest.mark.parametrize("value", [1.0, 1.5, 2.0, 3.5, 5.0])
def test_inverted_value_maps_back_to_itself(value):
    assert mapped(AGE.points, inverted(AGE.points, value)) == pytest.approx(value)


def test_falling_and_flat_points_can_be_inverted():
    falling = ((0.0, 5.0), (1.0, 3.0), (2.0, 3.0), (3.0, 1.0))
    assert [inverted(falling, v) for v in (5.0, 4.0, 3.0, 2.0, 1.0)] == [0.0, 0.5, 1.0, 2.5, 3.0]


def test_unreachable_value_inverts_to_nearest_point():
    assert inverted(AGE.points, 9.0) == 80.0
    assert inverted(AGE.points, 0.0) == 10.0


def test_reading_without_points_is_its_value():
    assert mapped(MOOD.points, 4.5) == 4.5
    assert inverted(MOOD.points, 4.5) == 4.5


def read(sources: Sources, spec: SourceSpec, raw: object, now: float, person: str = "") -> bool:
    return sources.read(spec, message_of({"data": raw}), now, person)


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (math.nan, "NOT_FINITE"),
        (math.inf, "NOT_FINITE"),
        (-math.inf, "NOT_FINITE"),
        (10**400, "NOT_FINITE"),
        ("4", "NOT_A_NUMBER"),
        (None, "NOT_A_NUMBER"),
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
    assert sources.latest("mood", 3.5).value == 2.0


def test_newest_reading_remains_when_all_are_stale(sources):
    read(sources, MOOD, 4.0, 1.0)
    read(sources, OTHER_MOOD, 2.0, 2.0)
    assert sources.latest("mood", 9.0).value == 2.0
    assert sources.latest("mood", 9.0).stale_at == 4.0
    assert sources.reading(MOOD, 9.0) is None


def test_changed_reading_is_distinguished_from_repetition(sources):
    assert read(sources, MOOD, 4.0, 1.0)
    assert not read(sources, MOOD, 4.0, 2.0)
    assert read(sources, MOOD, 3.0, 3.0)
    assert read(sources, MOOD, 3.0, 9.0), "it had been stale, so it is news again"


def test_boolean_is_read_as_zero_or_one(sources):
    read(sources, PERSON, True, 1.0)
    assert sources.latest_person().value == 1.0
    read(sources, PERSON, False, 2.0)
    assert sources.latest_person().value == 0.0


def test_person_is_unknown_before_first_reading():
    assert Sources(SPEC).latest("mood", 0.0) is None
    assert Sources(SPEC).latest_person() is None


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


def test_reading_may_be_computed():
    field = "3 + msg.valence * msg.confidence"
    assert after(topic(field), {"valence": 1.0, "confidence": 0.5}).value == 3.5


def test_table_maps_words_and_rejects_unknown_ones():
    source = topic("emotion", "table: {happy: 5, sad: 1, true: 2, 7: 3}")
    assert after(source, {"emotion": "happy"}).value == 5.0
    assert after(source, {"emotion": True}).value == 2.0
    assert after(source, {"emotion": 7}).value == 3.0
    assert after(source, {"emotion": 7.0}).value == 3.0
    assert after(source, {"emotion": ""}) is None, "no word is no measurement"
    with pytest.raises(Refused, match=r"^UNKNOWN_WORD: .*'angry', expected one of happy, sad"):
        after(source, {"emotion": "angry"})


def test_nan_field_takes_value_after_else():
    source = topic("msg.data else 2", "confidence: msg.sure else 0.5")
    assert after(source, {"data": math.nan, "sure": math.nan}).value == 2.0
    assert after(source, {"data": math.nan, "sure": math.nan}).confidence == 0.5
    assert after(source, {"data": 4.0, "sure": 1.0}).value == 4.0
    with pytest.raises(Refused, match="NOT_COMPUTABLE"):
        after(topic("msg.data + 1"), {"data": math.nan})


def test_reading_without_confidence_is_no_measurement():
    source = topic("data", "confidence: sure")
    assert after(source, {"data": math.nan, "sure": 0.0}) is None
    assert after(source, {"data": 2.0, "sure": False}) is None
    assert after(source, {"data": 2.0, "sure": 0.25}).confidence == 0.25
    kept = after(source, {"data": 2.0, "sure": 1.0}, {"data": 5.0, "sure": 0.0})
    assert kept.value == 2.0, "the last measurement stays until it is stale"


@pytest.mark.parametrize("sure", [1.01, -0.1, math.nan, math.inf, "high", None])
def test_confidence_outside_0_to_1_is_rejected(sure):
    with pytest.raises(Refused, match=r"^OUT_OF_RANGE: .*expected 0 to 1"):
        after(topic("data", "confidence: sure"), {"data": 2.0, "sure": sure})


@pytest.mark.parametrize("std", [-0.1, math.nan, math.inf, "small", None])
def test_negative_standard_deviation_is_rejected(std):
    with pytest.raises(Refused, match=r"^OUT_OF_RANGE: .*expected 0 or more"):
        after(topic("data", "std: doubt"), {"data": 2.0, "doubt": std})


def test_standard_deviation_is_mapped_with_the_reading():
    source = topic("data", "std: 0.5, map: {0: 1, 10: 5}")
    assert after(source, {"data": 5.0}).std == pytest.approx(0.2)
    at_the_end = after(source, {"data": 10.0}).std
    assert at_the_end == pytest.approx(0.2 / math.sqrt(2))
    for beyond in (10.4, 50.0):
        assert after(source, {"data": beyond}).std == at_the_end, "what is held is not exact"


def test_standard_deviation_is_bounded_by_that_of_range():
    source = topic("data", "std: 9e99, confidence: 1e-300")
    assert after(source, {"data": 2.0}).std == pytest.approx(4 / math.sqrt(12))


def test_table_leaves_standard_deviation_unmapped():
    source = topic("data", "std: 0.5, table: {sad: 1, happy: 5}")
    assert after(source, {"data": "sad"}).std == 0.5


def test_empty_list_is_ignored_but_missing_field_rejected():
    source = topic("faces.0.mood")
    assert after(source, {"faces": []}) is None
    with pytest.raises(Refused, match=r"^UNKNOWN_FIELD: .*no field 'faces\.0\.mood'"):
        after(source, {"faces": [{"age": 3}]})


def test_uncomputable_reading_is_rejected_and_counted():
    sources, spec = written(topic("msg.a / msg.b"))
    with pytest.raises(Refused, match=r"^NOT_COMPUTABLE: .*by zero"):
        sources.read(spec.sources[0], message_of({"a": 1, "b": 0}), 0.0)
    assert sources.refusals == {("face", "NOT_COMPUTABLE"): 1}


def test_smoothed_reading_lags_and_restarts_after_gap():
    sources, spec = written(topic("data", "smoothing: 1 s"))
    (mood,) = spec.sources
    read(sources, mood, 1.0, 0.0)
    assert read(sources, mood, 5.0, 1.0)
    assert sources.latest("mood", 1.0).value == pytest.approx(5.0 - 4.0 * math.exp(-1.0))
    read(sources, mood, 5.0, 9.0)
    assert sources.latest("mood", 9.0).value == 5.0


def test_per_person_source_keeps_readings_apart():
    sources, spec = written(topic("data", name="p/<person>/mood"), PERSONS)
    (mood,) = spec.sources
    read(sources, mood, 2.0, 0.0, "anna")
    read(sources, mood, 4.0, 0.0, "ben")
    assert sources.latest("mood", 1.0, "anna").value == 2.0
    assert sources.latest("mood", 1.0, "ben").value == 4.0
    assert sources.latest("mood", 1.0) is None
    sources.forget("anna")
    assert sources.latest("mood", 1.0, "anna") is None
    assert sources.latest("mood", 1.0, "ben").value == 4.0


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
