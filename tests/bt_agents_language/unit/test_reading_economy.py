# SPDX-License-Identifier: Apache-2.0
"""Reading is sparing: it leaves no garbage, and what files say again and again is there once."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_language.model.specs import AgentSpec, NodeSpec, iter_nodes
from file_texts import read_agent_text
from tree_harness import SYMBOLS

HEAD = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\n"
TREE = """\
tree:
  sequence:
    - check: scene.age >= 4
    - say: {text: "You are ${scene.age}."}
      timeout: 5 s
    - choose:
        children:
          - name: old
            when: scene.age >= 4
            say: Hello.
        otherwise: {subtree: part}
subtrees:
  part: {tree: {wait: 1 s}}
"""


def read(text: str) -> AgentSpec:
    return read_agent_text(HEAD + text, "a.yaml", SYMBOLS)


def of_kind(agent: AgentSpec, kind: str) -> list[NodeSpec]:
    return [spec for spec in iter_nodes(agent.tree) if spec.kind == kind]


@pytest.fixture
def collector() -> Iterator[None]:
    """Leave the collector as it was."""
    was_on = gc.isenabled()
    yield
    gc.enable() if was_on else gc.disable()


@pytest.mark.usefixtures("collector")
@pytest.mark.parametrize("text", [TREE, TREE.replace("scene.age >= 4", "scene.aeg >= 4")])
def test_reading_leaves_no_cycles_that_only_the_collector_could_free(text: str) -> None:
    def attempt() -> None:
        with suppress(ReadError):
            read(text)

    attempt()
    gc.collect()
    gc.disable()
    attempt()
    assert gc.collect() == 0


@pytest.mark.usefixtures("collector")
@pytest.mark.parametrize("on", [True, False])
@pytest.mark.parametrize("text", [TREE, "tree: {sya: Hello.}\n"])
def test_the_collector_is_on_or_off_after_reading_as_it_was_before(text: str, on: bool) -> None:
    gc.enable() if on else gc.disable()
    with suppress(ReadError):
        read(text)
    assert gc.isenabled() is on


def test_a_condition_that_is_written_twice_is_there_once() -> None:
    agent = read(TREE)
    (check,) = of_kind(agent, "check")
    (case,) = (one for one in of_kind(agent, "case") if one.fields)
    assert check.fields["condition"] is case.fields["condition"]


def test_the_same_words_are_another_condition_where_their_names_have_other_types() -> None:
    tree = "tree: {check: x == 'a'}\n"
    assert of_kind(read(f"tunables: {{x: {{default: a}}}}\n{tree}"), "check")
    with pytest.raises(ReadError, match="cannot compare a number with a text"):
        read(f"tunables: {{x: {{default: 1, min: 0, max: 2}}}}\n{tree}")


def test_defaults_that_are_not_written_are_shared_by_all_nodes() -> None:
    agent = read("tree: {sequence: [{say: Hello.}, {say: Good bye.}]}\n")
    first, second = of_kind(agent, "say")
    assert first.fields["rate"] is second.fields["rate"]
    assert first.outputs is second.outputs


def test_a_moved_node_differs_in_nothing_but_its_path_and_children() -> None:
    for spec in iter_nodes(read(TREE).tree):
        assert spec.moved("x", ()) == replace(spec, path="x", children=())
