# SPDX-License-Identifier: Apache-2.0
"""A folder of files: a broken agent affects no other; a broken scene or skill affects all."""

from __future__ import annotations

from pathlib import Path

import pytest

from agent_texts import agent_of, problems_of, refusal
from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.tree.raw_nodes import RawNodeReader
from tree_harness import TREES

SCENE = "format: 1\nparameters:\n  age: {min: 1, max: 5, default: 3}\n"
SKILLS = "format: 1\nskills:\n  beep:\n    topic: {name: beep, type: std_msgs/msg/Empty}\n"


def agent(name: str, tree: str = "{beep: }") -> str:
    return f"format: 1\nagent: {name}\nprofile: {{age: 3}}\ntree: {tree}\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("skills", "agents"):
        (tmp_path / name).mkdir()
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "skills" / "robot.yaml").write_text(SKILLS)
    (tmp_path / "agents" / "x.yaml").write_text(agent("zoe"))
    (tmp_path / "agents" / "y.yaml").write_text(agent("ann"))
    return tmp_path


def test_broken_agent_does_not_affect_other_agents(folder):
    (folder / "agents" / "a.yaml").write_text(agent("bob", "{bep: }"))
    trees = read_trees(folder)
    assert (trees.folder, [one.name for one in trees.agents]) == (folder, ["ann", "zoe"])
    (broken,) = trees.broken
    assert broken.file == folder / "agents" / "a.yaml"
    assert broken.error.lines == (
        f"{broken.file}:4:8: error[unknown-node]: there is no node or skill 'bep'",
    )


@pytest.mark.parametrize("word", ["sequence", "selector", "parallel", "random", "choose"])
@pytest.mark.parametrize("written", ["{}", "{children: {}}"])
def test_composite_with_empty_mapping_has_no_children(word, written):
    (problem,) = problems_of(agent_of, f"tree: {{{word}: {written}}}")
    assert (problem.code, problem.position.line) == ("no-children", 4)


def test_reader_fault_becomes_positioned_error_of_one_file(folder, monkeypatch):
    read = RawNodeReader.read

    def faulty(reader, node, *others):
        if node.entries[0].key.text == "boop":
            raise ZeroDivisionError
        return read(reader, node, *others)

    monkeypatch.setattr(RawNodeReader, "read", faulty)
    (folder / "agents" / "a.yaml").write_text(agent("bob", "{boop: }"))
    trees = read_trees(folder)
    assert [one.name for one in trees.agents] == ["ann", "zoe"]
    assert trees.broken[0].error.lines == (
        f"{folder / 'agents' / 'a.yaml'}:4:7: error[reader-fault]: bt-agents cannot read this: "
        "ZeroDivisionError",
    )


def test_non_yaml_files_in_folder_are_ignored(folder):
    (folder / "agents" / ".#x.yaml").symlink_to(folder / "nowhere")
    (folder / "agents" / "x.yaml~").write_text("[")
    (folder / "agents" / "notes.txt").write_text("[")
    assert read_trees(folder).broken == ()


def test_a_folder_without_skills_and_agents_is_empty(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    trees = read_trees(tmp_path)
    assert (trees.agents, trees.broken, dict(trees.symbols.skills)) == ((), (), {})


def test_broken_or_missing_scene_rejects_whole_folder(folder):
    (folder / "scene.yaml").write_text("format: 1\n")
    with pytest.raises(ReadError, match=r"scene.yaml:1:1: error\[missing-key\]"):
        read_trees(folder)
    (folder / "scene.yaml").unlink()
    with pytest.raises(ReadError, match=r"error\[no-file\]"):
        read_trees(folder)


def test_broken_skills_reject_folder_with_all_errors(folder):
    (folder / "skills" / "a.yaml").write_text("format: 2\nskills: {}\n")
    (folder / "skills" / "b.yaml").write_text(SKILLS)
    (folder / "skills" / "robot.yaml").write_text(SKILLS)
    first, second = refusal(read_trees, folder).lines
    assert "a.yaml:1:9: error[wrong-format]" in first
    assert "robot.yaml:3:3: error[duplicate-skill]: there is a skill 'beep' already" in second


def test_agents_can_be_selected_by_tag():
    trees = read_trees(TREES)
    names = {agent.name for agent in trees.tagged("care_home").agents}
    assert names == {"cheerful_voice", "large_print", "evening_round"}
    assert len(trees.tagged("care_home, intralogistics").agents) == 5
    assert trees.tagged("") == trees
    with pytest.raises(BtAgentsError, match="no agent has the tag 'home'; there are airport, "):
        trees.tagged("home")
