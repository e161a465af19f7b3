# SPDX-License-Identifier: Apache-2.0
"""What README, docs and launch files say is so."""

from __future__ import annotations

import re
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
import yaml

from bt_agents.cli.main import bt_agents
from bt_agents.language.agent_reader import read_agent_text
from bt_agents.language.folder_reader import read_trees
from bt_agents.language.libraries import FolderLibraries
from bt_agents.language.nodes import KINDS, MODIFIERS
from bt_agents.language.plugins import GROUP, read_plugins
from bt_agents.language.skills_reader import read_skills
from bt_agents.language.test_reader import read_test_text
from bt_agents.rehearsal.suite import failure, run_case
from stage import SPACE, TREES, VOCABULARY

ROOT = Path(__file__).parents[2]
DOCUMENTS = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
AGENT = """
format: 1
agent: example
title: Example
description: d
profile: {age: 3, familiarity: 3, mood: 3}
tree: {wait: 1 s}
"""


def blocks(language: str) -> list[tuple[str, str]]:
    found = []
    for path in DOCUMENTS:
        for text in re.findall(rf"```{language}\n(.*?)```", path.read_text(), re.DOTALL):
            found.append((path.name, text))
    return found


@pytest.mark.parametrize(("document", "text"), blocks("yaml"))
def test_every_yaml_example_can_be_read(document: str, text: str, tmp_path: Path) -> None:
    keys = yaml.safe_load(text)
    if {"test", "cases"} <= keys.keys():
        _check_test(text, document)
        return
    if {"skills", "bindings"} & keys.keys():
        path = tmp_path / "their.yaml"
        path.write_text(text)
        assert read_skills([TREES / "skills" / "robot.yaml", path])
        return
    if "format" in keys and "tree" not in keys:
        (tmp_path / "libraries").mkdir()
        (tmp_path / "libraries" / "their.yaml").write_text(text)
        assert FolderLibraries(tmp_path, VOCABULARY).load("libraries/their.yaml").subtrees
        return
    missing = [line for line in AGENT.splitlines() if line and line.split(":")[0] not in keys]
    agent = read_agent_text("\n".join(missing) + "\n" + text, document, VOCABULARY)
    assert len(agent.profile) == len(SPACE)


def _check_test(text: str, document: str) -> None:
    """Run the cases of a test file for one of the shipped agents."""
    test = read_test_text(text, document, read_trees(TREES).agents, SPACE)
    results = [run_case(test.agent, SPACE, case) for case in test.cases]
    assert not [failure(result) for result in results if not result.passed]


@pytest.mark.parametrize(("document", "text"), blocks("console"))
def test_every_command_exists_with_its_options(document: str, text: str) -> None:
    for command in re.findall(r"bt-agents ((?:[^#\n`]|#\S)+)", text):
        name, *words = command.split()
        assert name in bt_agents.commands, f"{document}: bt-agents {command}"
        known = {o for p in bt_agents.commands[name].params for o in (*p.opts, *p.secondary_opts)}
        assert {word for word in words if word.startswith("--")} <= known
    for script in re.findall(r"scripts/\w+", text):
        assert (ROOT / script).exists(), f"{document}: {script}"


def test_the_reference_names_every_node_and_every_modifier_in_order() -> None:
    text = (ROOT / "docs" / "language.md").read_text()
    for kind in KINDS:
        assert re.search(rf"^\| .*`{kind}[:` ]", text, re.MULTILINE), kind
    table = text.partition("## Modifiers")[2].partition("\n## ")[0]
    written = re.findall(r"^\| `(\w+):", table, re.MULTILINE)
    assert written == ["name", *MODIFIERS]


@pytest.mark.parametrize(("document", "text"), blocks("python"))
def test_every_python_example_runs_and_is_a_node(document: str, text: str) -> None:
    found: dict[str, object] = {}
    exec(compile(text, document, "exec"), found)
    classes = [one for one in found.values() if isinstance(one, type) and "fields" in vars(one)]
    assert len(classes) == 1
    point = EntryPoint(name="example", value=document, group=GROUP)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EntryPoint, "load", lambda _: classes[0])
        assert read_plugins([point]).problems == ()


def test_links_between_documents_lead_somewhere() -> None:
    for path in DOCUMENTS:
        for target in re.findall(r"\]\(([^)#:]+)\)", path.read_text()):
            assert (path.parent / target).exists(), f"{path.name}: {target}"


@pytest.mark.parametrize("path", sorted((ROOT / "bringup" / "launch").glob("*.yaml")))
def test_every_node_of_a_launch_file_is_an_executable_of_its_package(path: Path) -> None:
    folders = {
        re.search(r"<name>(.*)</name>", xml.read_text())[1]: xml.parent  # type: ignore[index]
        for xml in ROOT.glob("*/package.xml")
    }
    nodes = [
        entry["node"] for entry in yaml.safe_load(path.read_text())["launch"] if "node" in entry
    ]
    assert nodes
    for node in nodes:
        setup = (folders[node["pkg"]] / "setup.py").read_text()
        assert f'"{node["exec"]} = ' in setup, node
