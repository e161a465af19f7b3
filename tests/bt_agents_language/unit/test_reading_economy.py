# SPDX-License-Identifier: Apache-2.0
"""Economical reading: no garbage, and shared objects for repeated text."""

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
    """Restore the state of the collector."""
    was_on = gc.isenabled()
    yield
    gc.enable() if was_on else gc.disable()


@pytest.mark.usefixtures("collector")
@pytest.mark.parametrize("text", [TREE, TREE.replace("scene.age >= 4", "scene.aeg >= 4")])
def test_reader_leaves_no_reference_cycles(text: str) -> None:
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
def test_reader_restores_garbage_collector_state(text: str, on: bool) -> None:
    gc.enable() if on else gc.disable()
    with suppress(ReadError):
        read(text)
    assert gc.isenabled() is on


def test_repeated_condition_is_stored_once() -> None:
    agent = read(TREE)
    (check,) = of_kind(agent, "check")
    (case,) = (one for one in of_kind(agent, "case") if one.fields)
    assert check.fields["condition"] is case.fields["condition"]


def test_same_text_with_other_types_is_another_condition() -> None:
    tree = "tree: {check: x == 'a'}\n"
    assert of_kind(read(f"tunables: {{x: {{default: a}}}}\n{tree}"), "check")
    with pytest.raises(ReadError, match="cannot compare a number with a text"):
        read(f"tunables: {{x: {{default: 1, min: 0, max: 2}}}}\n{tree}")


def test_nodes_share_omitted_defaults() -> None:
    agent = read("tree: {sequence: [{say: Hello.}, {say: Good bye.}]}\n")
    first, second = of_kind(agent, "say")
    assert first.fields["rate"] is second.fields["rate"]
    assert first.outputs is second.outputs


def test_moved_node_changes_only_path_and_children() -> None:
    for spec in iter_nodes(read(TREE).tree):
        assert spec.moved("x", ()) == replace(spec, path="x", children=())
