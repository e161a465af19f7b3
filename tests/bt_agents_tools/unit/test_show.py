# SPDX-License-Identifier: Apache-2.0
"""`bt-agents show` and its flowcharts: exact output."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_language.diagnostics.renderers import columns
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.model.specs import AgentSpec, iter_nodes
from bt_agents_language.tools.drawing.boxes import BoxKind, box_of
from bt_agents_language.tools.drawing.mermaid import mermaid
from bt_agents_language.tools.drawing.outline import outline
from bt_agents_tools.cli.commands.show import show
from tree_harness import SPACE, TREES, agent

SHIPPED = read_trees(Path(os.path.relpath(TREES))).agents
"""Read as an author does: with paths that do not depend on the place of the checkout."""

HEAD = """\
requires: scene.person
tunables:
  patience: {default: 8 s, min: 2 s, max: 2 min, description: how long}
  rate: {default: 0.9, min: 0.5, max: 1.5, description: speed}
  polite: {default: true, description: manners}
on_cancel: {say: Bye.}
subtrees:
  pause:
    inputs: {long: duration}
    tree: {wait: "${long}"}
"""
TREE = """\
sequence:
  - say: {text: "Hello.", rate: "${rate}"}
  - name: look
    timeout: 90 s
    invert: true
    selector:
      memory: false
      children:
        - check: scene.age >= 4
        - ask: {text: "Where to?", wait: "${patience}"}
          retry: {attempts: 3, pause: 2 s}
          on_failure: {log: {message: "nobody  answers"}}
  - subtree: pause
    with: {long: "${patience}"}
  - set: {a: 5 s, b: "x ${answer}"}
    when: polite
"""


def example(**changes: object) -> AgentSpec:
    return replace(agent(TREE, HEAD), **changes)


def test_outline_shows_modifiers_as_nodes_with_line_numbers():
    expected = """\
a: A
  profile   age 3, familiarity 3, mood 3
  requires  scene.person
  tunables  patience 8 s (2 s to 2 min), rate 0.9 (0.5 to 1.5), polite true

tree
  18  ▼ sequence
  19  ├─ ● say "Hello.", rate ${rate}
  21  ├─ ◇ timeout 1.5 min
  22  │  └─ ◇ invert
  23  │     └─ ▼ look: selector starts over at each tick
  26  │        ├─ ○ check scene.age >= 4
  29  │        └─ ◇ on_failure
  28  │           ├─ ◇ retry 3, pause 2 s
  27  │           │  └─ ● ask "Where to?", wait ${patience} → answer
  29  │           └─ on failure: ○ log "nobody answers"
  30  ├─ ▶ subtree pause with long ${patience}
  15  │  └─ ○ wait ${long}
  33  └─ ◇ when polite
  32     └─ ○ set a = 5, b = "x ${answer}"

on_cancel
  11  ● say "Bye."
"""
    assert outline(example(), SPACE) == expected


def test_skills_missing_on_robot_are_named():
    missing = example(unoffered=("say: no robot offers it",))
    assert "\n  missing   say: no robot offers it\n" in outline(missing, SPACE)


def test_choices_show_conditions_and_weights():
    tree = """\
    choose:
      children:
        - {name: old, when: scene.age >= 4, random: [wait: 1 s, {wait: 2 s, weight: 2.5}]}
      otherwise: {wait: 3 s}
    """
    expected = """\
   8  ▼ choose
  10  ├─ ◇ case scene.age >= 4
  10  │  └─ ▼ old: random
  10  │     ├─ ◇ weight 1
  10  │     │  └─ ○ wait 1 s
  10  │     └─ ◇ weight 2.5
  10  │        └─ ○ wait 2 s
  11  └─ ◇ otherwise
  11     └─ ○ wait 3 s
"""
    assert outline(agent(tree), SPACE).partition("tree\n")[2] == expected


def test_lines_fit_terminal_width():
    head = """\
    subtrees:
      tell: {inputs: {words: text, again: text}, tree: {say: "${words}${again}"}}
    """
    tree = """\
    selector:
      - subtree: tell
        with: {words: "Put your bag on the platform, please.", again: "Your bag goes here."}
      - retry: 3
        say: {text: "A text of many words that the robot says slowly.", rate: 0.5}
    """
    spec = agent(tree, head)
    expected = """\
  10  ▼ selector
  11  ├─ ▶ subtree tell with words "Put your bag on the
      │  │     platform, please.",
      │  │     again "Your bag goes here."
   7  │  └─ ● say "${words}${again}"
  13  └─ ◇ retry 3
  14     └─ ● say "A text of many words that the robot
                  says slowly.", rate 0.5
"""
    assert outline(spec, SPACE, 60).partition("tree\n")[2] == expected
    long = replace(spec, tunables=example().tunables)
    assert outline(long, SPACE, 60).splitlines()[2:4] == [
        "  tunables  patience 8 s (2 s to 2 min),",
        "            rate 0.9 (0.5 to 1.5), polite true",
    ]


@pytest.mark.parametrize("spec", SHIPPED, ids=lambda spec: spec.name)
def test_every_agent_fits_80_columns(spec):
    assert max(map(columns, outline(spec, SPACE).splitlines())) <= 80


def test_required_children_of_parallel_are_named():
    children = "[say: a, {name: way, timeout: 3 s, drive: b}]"
    tree = f"parallel: {{succeed_on: [way], children: {children}}}"
    assert "▼ parallel succeed on [way]\n" in outline(agent(tree), SPACE)


def test_mermaid_shortens_texts_and_puts_inputs_on_lines():
    text = "Put your bag on the platform, please."
    spec = agent(f"ask: {{text: '{text}', choices: [now, later], wait: 5 s}}")
    label = (
        "ask<br/>#34;Put your bag on the platform,…#34;,"
        "<br/>choices #91;#34;now#34;, #34;later#34;#93;,<br/>wait 5 s"
    )
    assert label in mermaid(spec)


def test_long_texts_are_shortened():
    assert f'say "{"word " * 11}word…"' in outline(agent(f"say: {'word ' * 40}"), SPACE)


def test_mermaid_escapes_special_characters():
    nasty = replace(agent("say: 'a \"b\" <i> #1; %% {x} | ]'"), title='T: "x"\n---')
    expected = """\
---
title: "T: \\"x\\"\\n---"
---
flowchart TD
  tree_start([tree]) --> n0
  n0(["say #34;a #34;b#34; #60;i#62; #35;1#59; #37;#37; #123;x#125; #124; #93;#34;"]):::skill
"""
    drawn, *styles = mermaid(nasty).partition("  classDef ")
    assert drawn == expected
    assert "".join(styles).count("  classDef ") == len(BoxKind)


def test_mermaid_joins_every_node_to_its_parent():
    lines = mermaid(example()).splitlines()
    nodes = sum(
        1 for root in (example().tree, example().on_cancel) for _ in iter_nodes(box_of(root))
    )
    assert sum(":::" in line for line in lines) == nodes
    assert sum("-->" in line for line in lines) == nodes
    assert '  n6 -->|"on failure"| n9' in lines


def test_box_kinds_are_distinguishable():
    assert {box.kind for box in iter_nodes(box_of(example().tree))} == set(BoxKind)


@pytest.fixture
def shown(capsys):
    def call(*arguments: object) -> str:
        show.main([str(one) for one in arguments], standalone_mode=False)
        return capsys.readouterr().out

    return call


def test_agent_is_shown_by_name_or_file(shown):
    by_name = shown("attentive_guide", "--dir", TREES)
    assert by_name.startswith("attentive_guide: Attentive guide\n  profile   age 4, ")
    assert shown(TREES / "agents" / "attentive_guide.yaml") == by_name


def test_mermaid_flowchart_is_printed(shown):
    assert shown("silent_text", "--dir", TREES, "--format", "mermaid").startswith("---\ntitle: ")


def test_broken_agent_is_shown_with_errors(shown, tmp_path):
    (tmp_path / "agents").mkdir()
    (tmp_path / "scene.yaml").write_bytes((TREES / "scene.yaml").read_bytes())
    file = tmp_path / "agents" / "odd.yaml"
    file.write_text("format: 1\nagent: odd\n")
    for word in ("odd", file):
        with pytest.raises(ReadError, match=r"error\[missing-key\]"):
            shown(word, "--dir", tmp_path)


def test_file_names_are_relative_to_current_folder(shown, monkeypatch):
    monkeypatch.chdir(TREES.parent)
    text = shown(Path("trees/agents/cheerful_voice.yaml"))
    assert "random  (trees/libraries/manners.yaml)\n" in text
