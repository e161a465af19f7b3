# SPDX-License-Identifier: Apache-2.0
"""Rehearsals of agents and scenarios written in a test."""

from __future__ import annotations

import re
import textwrap

from bt_agents_language.files.testing.scenarios import AgentTest, Scenario
from bt_agents_language.files.testing.test_reader import read_scenario_text
from bt_agents_language.model.specs import AgentSpec
from bt_agents_tools.rehearsal.events import EventKind, Rehearsed
from bt_agents_tools.rehearsal.rehearsal import rehearse
from checkout import ROOT
from file_texts import read_test_text
from tree_harness import SPACE, SYMBOLS, agent


def scenario(spec: AgentSpec, text: str = "") -> Scenario:
    """Return the scenario of a YAML text with the keys of a case."""
    head = "format: 1\n"
    if "scene:" not in text:
        head += "scene: {age: 3, familiarity: 3, mood: 3}\n"
    return read_scenario_text(head + textwrap.dedent(text), "options", spec, SYMBOLS)


def rehearsed(tree: str, text: str = "", *, head: str = "") -> Rehearsed:
    """Rehearse the agent of a tree in a scenario."""
    spec = agent(tree, head)
    return rehearse(spec, SPACE, scenario(spec, text))


def cases_for(spec: AgentSpec, cases: str) -> AgentTest:
    """Return a test file for an agent."""
    text = f"format: 1\ntest: {spec.name}\ncases:\n" + textwrap.indent(
        textwrap.dedent(cases), "  "
    )
    return read_test_text(text, "a.test.yaml", [spec], SYMBOLS)


def events_of(result: Rehearsed, *kinds: EventKind) -> list[tuple[float, str]]:
    """Return the times of events of some kinds, with their skills or texts."""
    return [
        (round(event.at_s, 6), event.node.kind if event.node is not None else event.text)
        for event in result.events
        if event.kind in kinds
    ]


def documented_tree(page: str, words: str) -> str:
    """Return the only tree on a page of the documentation that has these words."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    trees = re.findall(r"```yaml\ntree:\n(.*?)```", text, re.DOTALL)
    [found] = [tree for tree in trees if words in tree]
    return textwrap.dedent(found)


def spoken_texts(result: Rehearsed) -> list[object]:
    """Return the texts of ``say`` and ``ask``, in order."""
    return [use.main for use in result.uses if use.spoken]
