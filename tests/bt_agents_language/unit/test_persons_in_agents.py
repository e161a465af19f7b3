# SPDX-License-Identifier: Apache-2.0
"""Person values in agents: names, remembered facts, told values, and persons nobody knows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from jsonschema import Draft7Validator

from agent_texts import refusal
from bt_agents_core.field_types import FieldType
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.endings import Outcome
from bt_agents_language.tools.folder_check import check_folder
from bt_agents_language.tools.schema.folder import schema_of
from file_texts import read_scene_text
from rehearsal_harness import cases_for, scenario
from tree_harness import SYMBOLS, agent

SCENE = """
format: 1
parameters:
  pain: {{min: 0, max: 10, default: 0, of: person}}
  mood: {{min: 1, max: 5, default: 3}}
remembers: {remembers}
"""


def problems(tree: str) -> list[str]:
    return [f"{one.code}: {one.message} ({one.hint})" for one in refusal(agent, tree).diagnostics]


def test_scene_yaml_declares_remembered_and_personal_values() -> None:
    spec = read_scene_text(SCENE.format(remembers="{tea: boolean, n: number}"), "scene.yaml")
    assert spec.space.remembers == {"tea": FieldType.BOOLEAN, "n": FieldType.NUMBER}
    assert spec.personal == {"pain"}


@pytest.mark.parametrize(
    ("remembers", "problem"),
    [
        ("{name: text}", "name-taken: 'person.name' is the name of the person"),
        ("{tea: duration}", "bad-choice"),
        ("[tea]", "wrong-type"),
        (f"{{{', '.join(f'k{n}: text' for n in range(33))}}}", "out-of-range: at most 32 values"),
    ],
)
def test_errors_in_remembered_values_are_reported(remembers: str, problem: str) -> None:
    text = SCENE.format(remembers=remembers)
    [one] = refusal(read_scene_text, text, "scene.yaml").diagnostics
    assert f"{one.code}: {one.message}".startswith(problem)


def test_requires_conditions_and_texts_may_name_person() -> None:
    tree = "say: ${person.name} ${person.favourite else 'tea'}\nwhen: person.visits > 1"
    agent(tree, "requires: person.visits > 1 and person.favourite == 'tea'")


NO_FACT = "unknown-name: scene.yaml has no '{}' under remembers"
NOT_SET = "unknown-name: 'set' cannot set"


@pytest.mark.parametrize(
    ("tree", "problem"),
    [
        ("say: ${person.nam}", "unknown-name: there is no name 'person.nam' here (did you mean"),
        ("check: person.visits == 'two'", "bad-expression"),
        ("remember: {favorite: tea}", f"{NO_FACT.format('favorite')} (did you mean 'favourite'?)"),
        (
            "remember: {size: 3}",
            f"{NO_FACT.format('size')} (declare it there: remembers: {{size: text}})",
        ),
        (
            "remember: {person.size: 3}",
            f"{NO_FACT.format('person.size')} (declare it there: remembers: {{size: text}})",
        ),
        ("remember: {name: anna}", "unknown-name"),
        ("remember: {favourite: [tea]}", "wrong-type: 'favourite': expected a text"),
        ("remember: {}", "missing-value"),
        ("remember: tea", "wrong-type"),
        ("set: {scene.age: old}", "bad-number"),
        ("set: {scene.person: true}", f"{NOT_SET} 'scene.person'"),
        (
            "set: {live.age: 3}",
            f"{NOT_SET} 'live.age', only the scene's parameters (did you mean 'scene.age'?)",
        ),
        (
            "set: {person.favourite: tea}",
            f"{NOT_SET} 'person.favourite' (write remember: {{favourite: …}})",
        ),
        ("set: {clock.hour: 3}", "bad-name"),
        (
            "sequence: [{ask: How old?}, {set: {scene.age: '${answer}'}}]",
            "wrong-value: 'scene.age': expected a number, but 'answer' is a text (for the number "
            "in it write ${number(answer)})",
        ),
    ],
)
def test_errors_about_persons_are_reported(tree: str, problem: str) -> None:
    [found] = problems(tree)
    assert found.startswith(problem)


def outcomes(node: NodeSpec) -> frozenset[Outcome]:
    return type_of(node).outcomes(node, ())


def test_node_using_scene_layer_may_fail() -> None:
    assert outcomes(agent("set: {n: 1}").tree) == {Outcome.SUCCESS}
    for tree in ("set: {n: 1, scene.age: 3}", "remember: {favourite: tea}"):
        node = agent(tree).tree
        assert outcomes(node) == {Outcome.SUCCESS, Outcome.FAILURE}
        assert type_of(node).resources(node).binding is not None


def test_rehearsal_declares_its_person() -> None:
    spec = agent("say: hello")
    said = scenario(spec, "person: {name: anna, visits: 3, remembers: {favourite: tea}}\nseed: 1")
    known = (said.known.name, said.known.visits, said.known.remembers)
    assert (said.person, known) == (True, ("anna", 3, {"favourite": "tea"}))
    assert scenario(spec, "person: false").known is None


@pytest.mark.parametrize(
    ("person", "problem"),
    [
        ("{visits: 2}", "needs the key 'name'"),
        ("{name: anna, visits: 0}", "'visits'"),
        ("{name: anna, remembers: {favorite: tea}}", "'favorite'"),
        ("{name: anna, remembers: {favourite: '${x}'}}", "${…}"),
        ("anna", "true or false"),
    ],
)
def test_errors_about_rehearsal_person_are_reported(person: str, problem: str) -> None:
    case = f"- name: one\n  person: {person}\n  ends: succeeded"
    assert problem in str(refusal(cases_for, agent("say: hello"), case))


@pytest.mark.parametrize(
    ("tree", "sound"),
    [
        ({"remember": {"favourite": "${answer}"}}, True),
        ({"remember": {"favorite": "tea"}}, False),
        ({"remember": {}}, False),
        ({"set": {"scene.age": 4, "n": "anything"}}, True),
        ({"set": {"scene.age": "old"}}, False),
    ],
)
def test_schema_covers_remembered_and_set_scene_values(tree: object, sound: bool) -> None:
    profile = {"age": 3, "familiarity": 3, "mood": 3}
    document = {"format": 1, "agent": "a", "profile": profile, "tree": tree}
    assert Draft7Validator(schema_of(AGENT, SYMBOLS)).is_valid(document) is sound


PAIN_SCENE = """\
format: 1
parameters:
  pain: {min: 0, max: 10, default: 0, of: person}
  age: {min: 1, max: 5, default: 3}
remembers: {drink: text}
"""
PERSONS = """\
persons:
  tracked: {topic: faces, type: a/msg/B, field: faces, id: face_id, stale_after: 1 s}
"""
KNOWN = "  known: {from: tracked, field: known}\n"
SOURCE = """\
sources:
  person: {topic: p, type: std_msgs/msg/Bool, field: data, stale_after: 1 s}
"""
NURSE = "format: 1\nagent: nurse\nprofile: {age: 3, pain: 3}\n"


def warnings_in(folder: Path, scene: str, agent: str) -> list[str]:
    (folder / "agents").mkdir()
    (folder / "scene.yaml").write_text(scene)
    (folder / "agents" / "nurse.yaml").write_text(NURSE + agent)
    return [
        f"{Path(one.position.file).name}:{one.position.line} {one.code}: {one.message}"
        for one in check_folder(folder).problems
    ]


@pytest.mark.parametrize(
    ("tree", "what"),
    [
        ("tree: {check: person.visits > 1}", "4 .*'person.visits' is missing"),
        ("tree:\n  remember: {drink: tea}", "5 .*'remember' keeps nothing"),
        ("requires: person.name == 'a'\ntree: {check: live.age > 2}", "1 .*'person."),
        (
            "tree:\n  sequence:\n    - log: ${person.drink}\n    - log: ${person.name}",
            "6 .*'person.drink' is missing",
        ),
    ],
)
@pytest.mark.parametrize("persons", ["", PERSONS])
def test_never_known_person_names_are_warned_about_once(tmp_path, tree, what, persons):
    (problem,) = warnings_in(tmp_path, PAIN_SCENE + (persons or SOURCE), tree)
    place, text = what.split(" ", 1)
    assert re.search(f"nurse.yaml:{place} nobody-known: {text}", problem)


@pytest.mark.parametrize(
    ("scene", "name"), [(PERSONS + KNOWN, "person.visits"), (SOURCE, "live.age")]
)
def test_known_or_seen_person_is_not_warned_about(tmp_path, scene, name):
    assert not warnings_in(tmp_path, PAIN_SCENE + scene, f"tree: {{check: {name} > 1}}")


def test_value_of_unseen_person_is_warned_about(tmp_path):
    (problem,) = warnings_in(tmp_path, PAIN_SCENE, "tree: {check: live.age > 2}")
    assert problem.startswith("scene.yaml:3 nobody-known: no source sees a person")
