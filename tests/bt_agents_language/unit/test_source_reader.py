# SPDX-License-Identifier: Apache-2.0
"""Sources, persons and places: valid files, and errors in others."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_language.model.scene_specs import AddresseeRule, MissingRule, SceneSpec
from fake_interfaces import FakeInterfaces
from file_texts import read_scene_text


class Faces(FakeInterfaces):
    """Fields whose names begin with good, with types according to their endings."""

    TYPES = {  # noqa: RUF012
        "word": FieldType.TEXT,
        "number": FieldType.NUMBER,
        "truth": FieldType.BOOLEAN,
    }

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        """Return why a type has no such field."""
        parts = path.split(".")
        known = parts[-2:-1] in (["good_list"], ["good_part"])
        if parts[-1].isdigit() and parts[-2] != "good_list":
            return f"'{parts[0]}' is a single value"
        if parts[-1] == "-":
            return f"no field '{path}'" if known else None
        good = all(part.startswith("good") or part.isdigit() for part in parts)
        return None if good else f"no field '{path}'"

    def field_type(self, kind: BindingKind, type_name: str, section: str, path: str) -> FieldType:
        """Return the type of a field's value."""
        return self.TYPES.get(path.rpartition("_")[2], FieldType.ANY)


TRACKED = (
    "tracked: {topic: t, type: known_msgs/msg/X, field: good_list, id: good, stale_after: 2 s}"
)
SCENE = """\
format: 1
parameters:
  mood: {{min: 1, max: 5, default: 3{parameter}}}
  age: {{min: 0, max: 100, default: 30}}
{more}
sources:
  mood: {source}
"""
SOURCE = "{topic: a, type: known_msgs/msg/X, field: good, stale_after: 2 s}"


def scene(source: str = SOURCE, more: str = "", parameter: str = "") -> SceneSpec:
    parameter = f", {parameter}" if parameter else ""
    text = SCENE.format(source=source, more=more, parameter=parameter)
    return read_scene_text(text, "s.yaml", Faces())


def source(**keys: str) -> str:
    given = {"topic": "a", "type": "known_msgs/msg/X", "field": "good", "stale_after": "2 s"}
    written = {**given, **keys}
    return "{" + ", ".join(f"{key}: {value}" for key, value in written.items() if value) + "}"


def persons(**keys: str) -> str:
    given = {"tracked": TRACKED.removeprefix("tracked: "), **keys}
    return "persons: {" + ", ".join(f"{key}: {value}" for key, value in given.items()) + "}"


def test_every_key_of_a_source_is_read():
    spec = scene(
        source(
            field='"msg.good_number + 1"',
            confidence="good_truth",
            std="0.5",
            smoothing="3 s",
            table="{1: 1, 2.0: 5}",
            latched="true",
        )
    )
    (one,) = spec.sources
    assert (one.field.text, one.path) == ("msg.good_number + 1", None)
    assert (one.confidence.text, one.std.text) == ("msg.good_truth", "0.5")
    assert (one.table, one.points) == ((("1", 1.0), ("2", 5.0)), ())
    assert (one.smoothing_s, one.latched, one.stale_after_s) == (3.0, True, 2.0)
    assert not one.per_person


def test_latched_source_needs_no_stale_after():
    (one,) = scene(source(stale_after="", latched="true")).sources
    assert one.stale_after_s == math.inf


def test_unlatched_source_needs_stale_after():
    assert "needs the key 'stale_after'" in problems(source(stale_after="", latched="false"))[0]
    tracked = source(field="good_list", id="good_word", stale_after="", latched="false")
    assert "needs the key 'stale_after'" in problems(SOURCE, persons(tracked=tracked))[0]


def test_table_keys_accept_any_boolean_spelling():
    (one,) = scene(source(field="good_truth", table="{True: 5, FALSE: 1}")).sources
    assert one.table == (("true", 5.0), ("false", 1.0))


def test_better_by_is_a_length():
    nearest = "{{rule: nearest, source: {{from: tracked, field: good}}, better_by: {}}}"
    for written, metres in (("30 cm", 0.3), ("0.3", 0.3), ("1 m", 1.0)):
        spec = scene(more=persons(addressee=nearest.format(written)))
        assert spec.persons.addressee.better_by == metres
    assert "0 m or more" in problems(SOURCE, persons(addressee=nearest.format("-1 cm")))[0]


def test_topic_has_one_type_everywhere():
    other = source(type="known_msgs/msg/Y")
    found = problems(f"[{SOURCE}, {other}]")
    assert len(found) == 1
    assert (
        "the topic 'a' has the type known_msgs/msg/Y here, and known_msgs/msg/X in line 7"
        in (found[0])
    )
    same_as_persons = source(topic="t", type="known_msgs/msg/Y")
    assert "the topic 't' has the type" in problems(same_as_persons, persons())[0]


@pytest.mark.parametrize("name", ["person", "stale", "place", "persons", "person_id"])
def test_reserved_scene_name_cannot_be_a_parameter(name):
    text = f"format: 1\nparameters: {{{name}: {{min: 0, max: 1, default: 0}}}}"
    with pytest.raises(ReadError, match="has a meaning of its own"):
        read_scene_text(text, "s.yaml")


def test_parameter_may_have_several_positioned_sources():
    spec = scene(f"[{SOURCE}, {source(topic='b')}]")
    assert [one.topic for one in spec.sources] == ["a", "b"]
    assert [one.position.column for one in spec.sources] == [10, 10 + len(SOURCE) + 2]


def test_parameters_have_weights_and_missing_rules():
    spec = scene(parameter="weight: 2, missing: estimate")
    assert [parameter.weight for parameter in spec.space.parameters] == [2.0, 1.0]
    assert spec.missing_rule("mood") is MissingRule.ESTIMATE
    assert spec.missing_rule("age") is MissingRule.LEAVE_OUT


def test_scene_without_person_has_declared_values():
    spec = scene(more="no_person: {mood: 3}")
    assert [parameter.unattended for parameter in spec.space.parameters] == [3.0, None]


def test_persons_have_tracked_known_and_addressee_sources():
    by = source(topic="p/<person>/x")
    spec = scene(
        source(topic="f/<face>/age"),
        persons(
            parts="{face: " + source(topic="p/<person>/face", field="good_word") + "}",
            known="{from: tracked, field: good_truth}",
            addressee="{rule: nearest, source: " + by + ", better_by: 0.3, for: 2 s}",
        ),
    ).persons
    assert (spec.tracked.topic, spec.tracked.field, spec.tracked.id) == ("t", "good_list", "good")
    assert (spec.tracked.stale_after_s, spec.tracked.lost_after_s) == (2.0, 1.0)
    assert [part.parameter for part in spec.parts] == ["face"]
    assert spec.known.of_item
    addressee = spec.addressee
    assert addressee.rule is AddresseeRule.NEAREST
    assert (addressee.better_by, addressee.hold_s) == (0.3, 2.0)
    assert addressee.source.placeholders == ("person",)


def test_addressee_rule_defaults_to_first():
    assert scene(more=persons()).persons.addressee.rule is AddresseeRule.FIRST
    assert scene(more=persons(addressee="first")).persons.addressee.rule is AddresseeRule.FIRST


def problems(source: str, more: str = "", parameter: str = "") -> list[str]:
    with pytest.raises(ReadError) as found:
        scene(source, more, parameter)
    return [f"error[{d.code}]: {d.message} ({d.hint})" for d in found.value.diagnostics]


@pytest.mark.parametrize(
    ("keys", "code", "words"),
    [
        ({"field": "msg.bad"}, "unknown-ros-field", "no field 'bad'"),
        ({"field": "msg.good + nothing"}, "unknown-name", "msg.nothing"),
        ({"field": "msg"}, "unknown-ros-field", "no field 'msg'"),
        ({"field": "good +"}, "bad-expression", "'field': "),
        ({"field": "good_word"}, "bad-expression", "table: {happy: 5, sad: 1}"),
        ({"field": "[1]"}, "wrong-type", "expected a text, found a list"),
        ({"field": '"[1, 2]"'}, "bad-expression", "'field' is a list"),
        ({"field": '"faces[0].age"'}, "bad-name", "write faces.0.age"),
        ({"field": '"faces[].age"'}, "bad-name", "write field names joined by points"),
        ({"field": "good_list"}, "bad-expression", "pick an item of it: good_list.0"),
        ({"field": "msg.good_part"}, "bad-expression", "name a field of it: good_part.…"),
        ({"confidence": "good_list"}, "bad-expression", "'confidence' is a list"),
        ({"confidence": "90 %"}, "bad-number", "write 0.9"),
        ({"confidence": "0"}, "out-of-range", "always 0, which means that nothing was measured"),
        ({"std": "5 %"}, "bad-number", "in the unit of the reading"),
        ({"std": "1e200"}, "out-of-range", "0 to 1e+100"),
        ({"field": "good_truth", "table": "{yes: 5, no: 1}"}, "wrong-type", "write true"),
        ({"field": "good_number", "table": "{happy: 5}"}, "bad-number", "found 'happy'"),
        ({"field": "good_number", "table": "{1: 5, 1.0: 4}"}, "duplicate-key", "reading 1 stands"),
        ({"topic": "p/<Person>/x"}, "bad-ros-name", "write <person>"),
        ({"stale_after": "", "stale": "1 s"}, "unknown-key", "did you mean 'stale_after'?"),
        ({"confidence": "good_word"}, "bad-expression", "'confidence' is a text"),
        ({"confidence": "1.5"}, "out-of-range", "'confidence' is 1.5, expected 0 to 1"),
        ({"confidence": "1 / 0"}, "bad-expression", "by zero"),
        ({"std": "-1"}, "out-of-range", "'std' is -1, expected 0 or more"),
        ({"std": "bad"}, "unknown-ros-field", "no field 'bad'"),
        ({"table": "{}"}, "missing-value", "'table' is empty"),
        ({"table": "{sad: 0}"}, "out-of-range", "expected 1 to 5"),
        ({"table": "[sad]"}, "wrong-type", "a mapping of words and values"),
        ({"table": "{sad: 1}", "map": "{0: 1, 1: 5}"}, "unknown-key", "beside 'map'"),
        ({"map": "{sad: 1, happy: 5}"}, "bad-number", "under 'table' instead of 'map'"),
        ({"smoothing": "2 Hz"}, "bad-duration", ""),
        ({"latched": "yes"}, "wrong-type", "write true"),
        ({"stale_after": ""}, "missing-key", "stale_after"),
        ({"topic": "p/<person>/x"}, "unknown-name", "needs 'persons'"),
        ({"topic": '"p/{person}/x"'}, "bad-ros-name", "write <person>"),
        ({"from": "tracked", "topic": "", "type": ""}, "unknown-name", "what the 'id' in each"),
        ({"from": "tracked"}, "unknown-key", "no key 'topic'"),
        ({"from": "traced", "topic": "", "type": ""}, "bad-choice", "did you mean 'tracked'?"),
    ],
)
def test_source_errors_are_reported(keys, code, words):
    found = problems(source(**keys))
    assert f"error[{code}]" in found[0]
    assert words in " ".join(found)


@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        ("place: [a]", "wrong-type", "expected a text"),
        (f"place: {'x' * 65}", "bad-name", "65 characters"),
        (f"place: {source(field='good_number')}", "bad-expression", "expected a text"),
        (f"place: {source(topic='p/<person>/x')}", "unknown-name", "not about one person"),
        ("no_person: {mod: 3}", "unknown-name", "did you mean 'mood'?"),
        ("no_person: {mood: 9}", "out-of-range", "expected 1 to 5"),
        ("persons: {}", "missing-key", "tracked"),
        (persons(addressee="nearest"), "missing-key", "how far away a person is"),
        (persons(addressee="closest"), "bad-choice", "engaged, nearest or first"),
        (persons(addressee="{rule: engaged}"), "missing-key", "add 'source: {…}'"),
        (persons(addressee="{rule: first, source: " + source(topic="p/<person>") + "}"),
         "unknown-key", "without a source"),
        (persons(addressee="{rule: engaged, source: " + SOURCE + "}"),
         "wrong-value", "write <person> where the topic has the id"),
        (persons(known=source(topic="p/<persn>/x")), "unknown-name", "did you mean 'person'?"),
        (persons(known="{from: tracked, field: good_word}"), "bad-expression", "compare it"),
        (persons(parts="{person: " + source(topic="p/<person>") + "}"), "name-taken", ""),
        (persons(parts="{face: " + source(topic="p/<face>") + "}"), "unknown-name", ""),
        (persons(addressee="{rule: first, better_by: 3}"), "unknown-key", "who came first"),
        (persons(tracked=source(field="good_list", id="good_number")),
         "wrong-value", "(good_number) is a number with a fraction, expected a text or a whole"),
        (persons(tracked=source(field="good_list", id="good_truth")),
         "wrong-value", "is true or false"),
        (persons(tracked=source(field="good_list", id="good_part")),
         "wrong-value", "is a message"),
        (persons(tracked=source(field="good_list", id="good_list")), "wrong-value", "is a list"),
        (persons(tracked=source()), "unknown-ros-field", "'field' is not a list"),
        (persons(tracked=source(field="good_list", id="bad")), "unknown-ros-field", "list.0.bad"),
        (persons(tracked=source(field="good_list", topic="<x>")), "unknown-name", ""),
    ],
)  # fmt: skip
def test_person_and_place_errors_are_reported(more, code, words):
    found = problems(SOURCE, more, "")
    assert f"error[{code}]" in found[0]
    assert words in " ".join(found)


def test_persons_exclude_separate_person_source():
    found = problems(SOURCE, f"{persons()}\nsources_: 1", "")
    assert "unknown-key" in found[0]
    text = SCENE.format(source=f"{SOURCE}\n  person: {SOURCE}", more=persons(), parameter="")
    with pytest.raises(ReadError, match="somebody is there: when somebody is tracked"):
        read_scene_text(text, "s.yaml")


@pytest.mark.parametrize(
    ("parameter", "code"),
    [
        ("weight: -1", "out-of-range"),
        ("missing: guess", "bad-choice"),
        ("wieght: 2", "unknown-key"),
    ],
)
def test_parameter_errors_are_reported(parameter, code):
    assert f"error[{code}]" in problems(SOURCE, "", parameter)[0]
