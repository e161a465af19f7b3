# SPDX-License-Identifier: Apache-2.0
"""The reference: a page for every word of the language, with a working example."""

from __future__ import annotations

import runpy
from dataclasses import replace

import pytest
from py_trees.behaviours import Success

from agent_texts import agent_of, refusal
from bt_agents.engine.run import Run
from bt_agents.engine.scripted_environment import ScriptedEnvironment
from bt_agents_core.field_types import FieldType
from bt_agents_language.expression.functions import FUNCTIONS
from bt_agents_language.expression.operators import BINARY, PREFIXES
from bt_agents_language.expression.units import DIMENSIONS
from bt_agents_language.fields.scope import mood_names, scene_names
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES, SIBLINGS
from bt_agents_language.nodes.node_type import NodeField, NodeType
from bt_agents_language.reference.node_pages import Group, node_page, subtree_page
from bt_agents_language.reference.reference_page import reference_page
from bt_agents_language.reference.topics import MEANINGS, TOPICS, topic
from checkout import ROOT
from tree_harness import SPACE, SYMBOLS, scene

GENERATED = runpy.run_path(str(ROOT / "scripts" / "generated.py"))["GENERATED"]
WORDS = [*NODE_TYPES, *SYMBOLS.skills, *DECORATORS, *SIBLINGS]


def page_of(key, symbols=SYMBOLS):
    page = node_page(key, symbols)
    assert page is not None
    return page


def test_every_word_of_the_language_has_an_example():
    table = (*NODE_TYPES.values(), *DECORATORS.values(), *SIBLINGS.values())
    assert [one.key for one in table if not one.example] == []


@pytest.mark.parametrize("key", WORDS)
def test_word_example_uses_it_in_runnable_tree(key):
    page = page_of(key)
    assert f"{key}:" in page.example
    agent = agent_of(page.example)
    awarded = scene(age=3, familiarity=3, mood=3)
    run = Run(
        agent,
        space=SPACE,
        scene=awarded,
        profile=agent.profile,
        live=lambda: awarded,
        tunables={},
        environment=(world := ScriptedEnvironment({}, result={"message": "", "answer": "yes"})),
        steady=world.clock,
    )
    run.tick()


def test_plugin_page_is_built_from_fields():
    blink = NodeType(
        key="blink",
        main="colour",
        fields=(
            NodeField(name="colour", type=FieldType.TEXT, description="its colour"),
            NodeField(name="period", type=FieldType.DURATION, required=False, default=0.5),
        ),
        description="Blinks.",
        plugin=Success,
    )
    words = replace(SYMBOLS, plugins={"blink": blink})
    page = page_of("blink", words)
    assert page.group is Group.PLUGIN
    assert page.forms == ("blink: <text>", "blink: {colour: …, period: …}")
    assert page.fields[1].default == "0.5 s"
    agent_of(page.example, words)
    assert "### blink\n\nBlinks." in reference_page(words)


BLINK = replace(SYMBOLS, plugins={"blink": NodeType(key="blink", plugin=Success)})


def test_a_node_without_fields_is_its_bare_key():
    page = page_of("blink", BLINK)
    assert page.forms == ("blink:",)
    assert page.example == "tree:\n  blink:\n"
    for tree in (page.example, "tree:\n  blink: {}\n", "tree: {sequence: [{blink: }]}\n"):
        agent_of(tree, BLINK)


def test_a_node_without_fields_takes_no_value():
    (problem,) = refusal(agent_of, "tree: {blink: 3}\n", BLINK).diagnostics
    assert (problem.code, problem.message) == ("wrong-type", "'blink' has no fields, found '3'")


@pytest.mark.parametrize("name", ["greet", "tell", "ask_twice", "clear_the_way"])
def test_library_subtree_example_imports_its_library(name):
    libraries = SYMBOLS.libraries
    assert libraries is not None
    subtree = libraries.load("libraries/manners.yaml").subtrees[name]
    page = subtree_page("libraries/manners.yaml", subtree)
    assert page.group is Group.SUBTREE
    assert page.description.endswith(".")
    assert all(field.description for field in (*page.fields, *page.outputs))
    agent_of(page.example)


@pytest.mark.parametrize("key", TOPICS)
def test_topic_example_works(key):
    page = topic(key, SPACE)
    assert page is not None
    assert page.key == key
    agent_of(page.example)


def test_topics_list_all_units_operators_functions_and_values():
    def words(key):
        page = topic(key, SPACE)
        assert page is not None
        return " ".join(word for rows in page.tables.values() for row in rows for word in row)

    for dimension in DIMENSIONS.values():
        assert dimension.listed in words("units")
    for word in (*BINARY, *PREFIXES, *(one.usage for one in FUNCTIONS.values())):
        assert word in words("expressions")
    assert {one.strength for one in (*BINARY.values(), *PREFIXES.values())} == set(MEANINGS)
    for name in (*scene_names(SPACE, ("scene", "live", "profile")), *mood_names(SPACE)):
        assert name in words("names")
    assert topic("numbers", SPACE) is None


@pytest.mark.parametrize("name", GENERATED)
def test_generated_file_matches_the_tables(name):
    written = (ROOT / name).read_text(encoding="utf-8")
    assert written == GENERATED[name](), "run scripts/generate"
