# SPDX-License-Identifier: Apache-2.0
"""Libraries: skills and subtrees shared by agents of a trees folder."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest

from agent_texts import refusal
from bt_agents_core.gc_pause import gc_paused
from bt_agents_language.diagnostics.renderers import as_text
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import read_symbols, read_trees
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.tools.folder_check import check_folder
from tree_harness import TREES

AGENT = """
format: 1
agent: a
imports: [{imports}]
profile: {{age: 3, familiarity: 3, mood: 3}}
tree: {tree}
"""
MANNERS = """
format: 1
subtrees:
  greet:
    inputs: {who: text}
    outputs: {reply: text}
    tree:
      sequence:
        - say: Hello ${who}.
        - ask: How are you?
          outputs: {reply: answer}
"""


IMPORTS = "imports: [libraries/manners.yaml]\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a trees folder with the shipped scene and skills, and one library."""
    for name in ("skills", "libraries", "agents"):
        (tmp_path / name).mkdir()
    shutil.copy(TREES / "scene.yaml", tmp_path)
    shutil.copy(TREES / "skills" / "robot.yaml", tmp_path / "skills")
    (tmp_path / "libraries" / "manners.yaml").write_text(MANNERS)
    return tmp_path


def agent(folder: Path, tree: str, *imports: str) -> AgentSpec:
    path = folder / "agents" / "a.yaml"
    path.write_text(AGENT.format(tree=tree, imports=", ".join(f'"{one}"' for one in imports)))
    return read_agent(path, read_symbols(folder))


def problems(folder: Path, tree: str, *imports: str) -> list[str]:
    """Return 'line:column code: message' of every error of an agent."""
    return [
        f"{one.position.line}:{one.position.column} {one.code}: {one.message}"
        for one in refusal(agent, folder, tree, *imports).diagnostics
    ]


def library(folder: Path, name: str, text: str) -> None:
    path = folder / "libraries" / f"{name}.yaml"
    path.write_text(f"format: 1\n{text}")


def test_library_subtree_keeps_its_own_positions(folder):
    call = "{sequence: [{subtree: greet, with: {who: you}}, {say: 'Ah, ${reply}.'}]}"
    spec = agent(folder, call, "libraries/manners.yaml")
    say = spec.tree.children[0].children[0].children[0]
    assert say.path == "tree/0.subtree/greet/0.say"
    assert str(say.position).startswith(f"{folder}/libraries/manners.yaml:9:")


def test_library_can_import_another_library(folder):
    call = "sequence: [{subtree: greet, with: {who: you}}, {say: '${reply}'}]"
    library(folder, "visits", f"{IMPORTS}subtrees: {{visit: {{tree: {{{call}}}}}}}\n")
    spec = agent(folder, "{subtree: visit}", "libraries/visits.yaml")
    path = spec.tree.children[0].children[0].children[0].children[0].path
    assert path == "tree/visit/0.subtree/greet/0.say"


def test_library_declarations_apply_to_it_and_importers(folder):
    tree = "{sequence: [{subtree: greet, with: {who: you}}, {check: reply >= 4}]}"
    assert problems(folder, tree, "libraries/manners.yaml") == [
        "6:63 bad-expression: 'check': '>=' needs a number on each side, found a text"
    ]
    call = "{subtree: greet, with: {who: you}, outputs: {level: reply}}"
    measure = f"{{outputs: {{level: number}}, tree: {call}}}"
    library(folder, "pain", f"{IMPORTS}subtrees: {{measure: {measure}}}\n")
    [broken] = [one for one in read_trees(folder).broken if one.file.name == "pain.yaml"]
    [line] = broken.error.lines
    assert "output 'level': expected a number, but 'subtree' gives it a text" in line


def test_forgotten_import_hint_names_providing_library(folder):
    library(folder, "broken", "subtrees: {greet: 1}\n")
    (problem,) = refusal(agent, folder, "{subtree: greet, with: {who: you}}").diagnostics
    assert problem.hint == "add imports: [libraries/manners.yaml], which has it"


def test_forgotten_import_hint_creates_no_import_cycle(folder):
    needs = "imports: [libraries/{}.yaml]\nsubtrees: {{{}: {{tree: {{subtree: {}}}}}}}\n"
    library(folder, "first", "subtrees: {one: {tree: {subtree: two}}}\n")
    library(folder, "second", needs.format("first", "two", "one"))
    broken = {one.file.name: one.error.lines[0] for one in read_trees(folder).broken}
    assert "error[unknown-subtree]" in broken["first.yaml"]
    assert "error[broken-import]" in broken["second.yaml"]


def test_thousand_nested_imports_report_on_one_screen(folder):
    for number in range(1000):
        following = f"imports: [libraries/l{number + 1}.yaml]\n" if number < 999 else ""
        library(
            folder, f"l{number}", f"{following}subtrees: {{s{number}: {{tree: {{say: hi}}}}}}\n"
        )
    found = check_folder(folder, None).problems
    assert len(found) > 900
    lines = as_text(found).splitlines()
    assert len(lines) <= 24
    assert any(line.endswith("places: imports are nested more than 16 deep") for line in lines)


@pytest.mark.parametrize("path", ["manners", "maners", "libraries/manners", "manners.txt"])
def test_bare_library_name_gets_path_hint(folder, path):
    (first, *_) = refusal(agent, folder, "{say: x}", path).diagnostics
    assert first.hint == "write libraries/manners.yaml"


def test_import_cycle_is_shown(folder):
    library(folder, "a", "imports: [libraries/b.yaml]\nsubtrees: {x: {tree: {say: x}}}\n")
    library(folder, "b", "imports: [libraries/a.yaml]\nsubtrees: {y: {tree: {say: y}}}\n")
    found = problems(folder, "{say: x}", "libraries/a.yaml")
    assert len(found) == 1
    assert found[0].startswith("4:11 broken-import: ")
    assert "import-cycle in line 2" in found[0]
    trees = read_trees(folder)
    circle = "libraries/a.yaml → libraries/b.yaml → libraries/a.yaml"
    assert [circle in broken.error.report for broken in trees.broken[1:]] == [True, True]


def test_broken_library_breaks_only_its_importers(folder):
    library(folder, "bad", "subtrees: {greet: {tree: {sya: x}}}\n")
    agent(folder, "{say: x}", "libraries/manners.yaml")
    text = AGENT.format(tree="{say: x}", imports="libraries/bad.yaml")
    (folder / "agents" / "b.yaml").write_text(text.replace("agent: a", "agent: b"))
    trees = read_trees(folder)
    assert [spec.name for spec in trees.agents] == ["a"]
    assert [broken.file.name for broken in trees.broken] == ["b.yaml", "bad.yaml"]


def test_check_of_8000_nodes_takes_under_one_second(folder):
    tree = "{sequence: [" + ", ".join(f"{{say: Word {number}.}}" for number in range(8000)) + "]}"
    (folder / "agents" / "a.yaml").write_text(AGENT.format(tree=tree, imports=""))
    # The collector would visit all objects that thousands of other tests have left.
    with gc_paused():
        begin = time.process_time()
        checked = check_folder(folder, None)
        took = time.process_time() - begin
    assert took < 1.0
    assert checked.agents == ("a",)
