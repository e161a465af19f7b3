# SPDX-License-Identifier: Apache-2.0
"""Variants of a skill's text: reading, checking, drawing and export."""

from __future__ import annotations

import pytest
from jsonschema import Draft7Validator

from agent_texts import HEAD, agent_of, refusal
from bt_agents_groot.agent_export import export_agent
from bt_agents_groot.agent_import import import_agent
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.model.specs import Literal, NodeSpec, Variants
from bt_agents_language.tools.drawing.value_format import format_value
from bt_agents_language.tools.schema.folder import schema_of
from bt_agents_language.yaml.source import Source
from core_schema import loaded
from file_texts import read_agent_text
from tree_harness import SYMBOLS, agent

SCHEMA = Draft7Validator(schema_of(AGENT, SYMBOLS))


def node(tree: str) -> NodeSpec:
    return agent(tree).tree


def refused_by_schema(tree: str) -> bool:
    return bool(list(SCHEMA.iter_errors(loaded(f"{HEAD}tree: {{{tree}}}\n"))))


def test_variants_replace_main_text_beside_other_inputs():
    spec = node("say: {one_of: [Hello., Hi.], rate: 0.8}")
    assert spec.fields["text"] == Variants(texts=(Literal(value="Hello."), Literal(value="Hi.")))
    assert spec.fields["rate"] == Literal(value=0.8)
    assert spec.name == "say one_of …"
    assert not refused_by_schema("say: {one_of: [Hello., Hi.], rate: 0.8}")


@pytest.mark.parametrize(
    ("tree", "code", "message", "hint", "by_schema"),
    [
        ("say: {one_of: [Hello.]}", "missing-value", "needs two texts or more", "without", True),
        ("say: {one_of: []}", "missing-value", "needs two texts or more", "", True),
        ("say: {one_of: Hello.}", "wrong-type", "expected a list of texts", "'- '", True),
        ("say: {one_of: [Hello., [a]]}", "wrong-type", "expected a text", "", True),
        ("say: {one_of: [a, b], text: c}", "contradiction", "which replaces", "keep one", False),
        ("say: {rate: 1}", "missing-key", "needs the key 'text'", "", True),
        ("say: [a, b]", "wrong-type", "found a list", "write {one_of: […]}", True),
        ("drive: {oneof: [a, b]}", "unknown-key", "no key 'oneof'", "'one_of'", True),
        ("say: {one_of: [a, 'b ${nmae}']}", "unknown-name", "no name 'nmae'", "", False),
        ("say: {rate: {one_of: [1, 2]}, text: a}", "wrong-type", "expected a number", "", True),
        ("log: {one_of: [a, b]}", "unknown-key", "no key 'one_of'", "", True),
    ],
)
def test_variant_errors_are_reported(tree, code, message, hint, by_schema):
    [found] = [one for one in refusal(agent, tree).diagnostics if one.code == code]
    assert message in found.message
    assert hint in found.hint
    assert refused_by_schema(tree) is by_schema


def test_drawing_shows_all_variants():
    shown = format_value(node("say: {one_of: [Hello., 'Hi ${clock.hour}.']}").fields["text"])
    assert shown == 'one of "Hello.", "Hi ${clock.hour}."'


def test_groot_round_trip_keeps_variants():
    ask = "{one_of: ['Shall we?', 'Ready, ${clock.weekday}?'], choices: [yes, no], wait: 3 s}"
    keys = f"tree: {{ask: {ask}}}\n"
    exported = export_agent(Source("a.yaml", HEAD + keys), SYMBOLS)
    imported = import_agent(Source("a.xml", exported.text), "a", SYMBOLS)
    after = read_agent_text(imported.text, "a.yaml", SYMBOLS)
    assert after.tree.fields == agent_of(keys).tree.fields
