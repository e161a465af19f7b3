# SPDX-License-Identifier: Apache-2.0
"""scene.yaml: its parameters, sources, persons and places, and errors in them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest

from agent_texts import refusal
from bt_agents_core.errors import ReadError
from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.model.scene_specs import AddresseeRule, MissingRule, SceneSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tools.drawing.outline import outline
from bt_agents_language.tools.schema.generator import file_schema
from fake_interfaces import FakeInterfaces
from file_texts import read_agent_text, read_scene_text
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


SCENE_TEXT = """\
format: 1
parameters:
  pain: {min: 0, max: 10, default: 0, profile: false, of: person}
  age: {min: 1, max: 5, default: 3}
"""
AGENT_TEXT = """\
format: 1
agent: nurse
profile: {age: 4}
requires: scene.pain < 9
tree:
  sequence:
    - check: scene.pain > 3
    - set: {scene.pain: 2}
    - check: live.pain <= 2
"""
SYMBOLS = SymbolTable(space=read_scene_text(SCENE_TEXT, "scene.yaml").space, skills={})


def test_agent_uses_parameter_without_profile_value():
    assert read_agent_text(AGENT_TEXT, "nurse.yaml", SYMBOLS).profile == (4.0,)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("profile: {age: 4}", "profile: {age: 4, pain: 3}"),
        ("requires:", "weights: {pain: 2}\nrequires:"),
        ("requires:", "learning: {rates: {pain: 0.2}}\nrequires:"),
        ("requires:", "learning: {freeze: [pain]}\nrequires:"),
        ("requires:", "learning: {retreat: {pain: 2}}\nrequires:"),
        ("set: {scene.pain: 2}", "give_feedback: {kind: direct, values: {pain: 2}}"),
    ],
)
def test_profile_keys_may_not_name_the_parameter(old, new):
    error = refusal(read_agent_text, AGENT_TEXT.replace(old, new), "nurse.yaml", SYMBOLS)
    wanted = "error[wrong-value]: no profile has 'pain': scene.yaml says 'profile: false'"
    assert wanted in error.lines[0]


def test_profile_value_of_parameter_is_unknown_name():
    text = AGENT_TEXT.replace("live.pain <= 2", "profile.pain <= 2")
    assert "unknown-name" in refusal(read_agent_text, text, "nurse.yaml", SYMBOLS).lines[0]


def test_drawing_and_schema_show_no_profile_value():
    agent = read_agent_text(AGENT_TEXT, "nurse.yaml", SYMBOLS)
    assert "pain" not in outline(agent, SYMBOLS.space, 80).splitlines()[1]
    profile = file_schema(AGENT, SYMBOLS.space)["properties"]["profile"]
    assert (list(profile["properties"]), profile["required"]) == (["age"], ["age"])


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
    text = SCENE.format(source=source, more=more, parameter=parameter)
    return read_scene_text(text, "s.yaml", Faces())


def source(**keys: str) -> str:
    given = {"topic": "a", "type": "known_msgs/msg/X", "field": "good", "stale_after": "2 s"}
    return written({**given, **keys})


def persons(**keys: str) -> str:
    given = {"tracked": source(topic="t", field="good_list", id="good")}
    return f"persons: {written({**given, **keys})}"


def written(keys: Mapping[str, str]) -> str:
    return "{" + ", ".join(f"{key}: {value}" for key, value in keys.items() if value) + "}"


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
    for length, metres in (("30 cm", 0.3), ("0.3", 0.3), ("1 m", 1.0)):
        spec = scene(more=persons(addressee=nearest.format(length)))
        assert spec.persons.addressee.better_by == metres
    assert "0 m or more" in problems(SOURCE, persons(addressee=nearest.format("-1 cm")))[0]


def test_topic_has_one_type_everywhere():
    other = source(type="known_msgs/msg/Y")
    (found,) = problems(f"[{SOURCE}, {other}]")
    types = "has the type known_msgs/msg/Y here, and known_msgs/msg/X in line 7"
    assert f"the topic 'a' {types}" in found
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
    spec = scene(parameter=", weight: 2, missing: estimate")
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
    addressee = (spec.addressee.rule, spec.addressee.better_by, spec.addressee.hold_s)
    assert addressee == (AddresseeRule.NEAREST, 0.3, 2.0)
    assert spec.addressee.source.placeholders == ("person",)


def test_addressee_rule_defaults_to_first():
    assert scene(more=persons()).persons.addressee.rule is AddresseeRule.FIRST
    assert scene(more=persons(addressee="first")).persons.addressee.rule is AddresseeRule.FIRST


def problems(source: str, more: str = "") -> list[str]:
    found = refusal(scene, source, more).diagnostics
    return [f"error[{one.code}]: {one.message} ({one.hint})" for one in found]


@pytest.mark.parametrize(
    ("keys", "code", "words"),
    [
        ({"type": "other/msg/X"}, "unknown-ros-type", "no ROS type 'other/msg/X'"),
        ({"field": "msg.bad"}, "unknown-ros-field", "no field 'bad'"),
        ({"field": "msg"}, "unknown-ros-field", "no field 'msg'"),
        ({"field": "good +"}, "bad-expression", "'field': "),
        ({"field": "good_word"}, "bad-expression", "table: {happy: 5, sad: 1}"),
        ({"field": '"[1, 2]"'}, "bad-expression", "'field' is a list"),
        ({"field": '"faces[0].age"'}, "bad-name", "write faces.0.age"),
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
        ({"table": "{}"}, "missing-value", "'table' is empty"),
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
        (persons(tracked=source()), "unknown-ros-field", "'field' is not a list"),
        (persons(tracked=source(field="good_list", id="bad")), "unknown-ros-field", "list.0.bad"),
        (persons(tracked=source(field="good_list", topic="<x>")), "unknown-name", ""),
    ],
)  # fmt: skip
def test_person_and_place_errors_are_reported(more, code, words):
    found = problems(SOURCE, more)
    assert f"error[{code}]" in found[0]
    assert words in " ".join(found)
