# SPDX-License-Identifier: Apache-2.0
"""The texts that a host sends make each agent again as it is in force, whatever has changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bt_agents.host.reload.source_bundle import source_bundle
from bt_agents_lab.replay.texts import TextFiles
from bt_agents_language.model.specs import AgentSpec, iter_nodes
from reload_harness import MANNERS, SKILLS, Watched, agent, new_folder, write

GREETER = "imports: [libraries/manners.yaml]\n"


@pytest.fixture
def watched(tmp_path: Path) -> Watched:
    folder = new_folder(tmp_path / "trees", "anna", "bert")
    write(folder, "anna", agent("anna", "{subtree: greet}", GREETER))
    return Watched(folder)


def check(watched: Watched) -> dict[str, str]:
    """Check that each agent can be made again; return the texts."""
    bundle = source_bundle(watched.versions, lambda _package: True)
    texts = TextFiles(files=bundle.files, versions=bundle.versions)
    for name, spec in watched.in_force.items():
        parsed = texts.parsed_for(name)
        [again] = [one for one in parsed.trees.agents if one.name == name]
        assert texts_of(again) == texts_of(spec)
    return bundle.files


def texts_of(spec: AgentSpec) -> list[Any]:
    """Return what an agent says."""
    return [node.fields["text"] for node in iter_nodes(spec.tree) if "text" in node.fields]


def apart(files: dict[str, str]) -> list[str]:
    return sorted(name for name in files if name.startswith("apart/"))


def library(watched: Watched, text: str) -> None:
    (watched.folder / "libraries" / "manners.yaml").write_text(text)


def test_what_its_folder_says_has_no_texts_of_its_own(watched: Watched) -> None:
    assert apart(check(watched)) == []
    library(watched, MANNERS.replace("Good day", "Hello"))
    watched.poll()
    assert apart(check(watched)) == []


def test_an_agent_that_waits_has_the_library_that_it_runs_with(watched: Watched) -> None:
    watched.running = "anna"
    library(watched, MANNERS.replace("Good day", "Hello"))
    watched.poll()
    files = check(watched)
    assert "Good day" in files["apart/anna/libraries/manners.yaml"]
    assert "Hello" in files["libraries/manners.yaml"]
    assert not any("bert" in name for name in apart(files))
    watched.end_run()
    assert apart(check(watched)) == []


def test_a_broken_library_leaves_the_one_in_force(watched: Watched) -> None:
    library(watched, "format: [")
    watched.poll()
    assert "Good day" in check(watched)["apart/anna/libraries/manners.yaml"]


def test_broken_skills_leave_those_in_force(watched: Watched) -> None:
    (watched.folder / "skills" / "robot.yaml").write_text("format: [")
    watched.poll()
    files = check(watched)
    assert files["skills/robot.yaml"] == SKILLS
    assert apart(files) == []


def test_two_agents_of_one_file_are_told_apart_until_the_first_has_ended(watched: Watched) -> None:
    watched.running = "bert"
    file = watched.folder / "agents" / "bert.yaml"
    file.write_text(agent("carl", "{say: I am carl}"))
    watched.poll()
    assert "agents/bert.yaml" in {name.removeprefix("apart/bert/") for name in check(watched)}
    assert set(watched.in_force) == {"anna", "bert", "carl"}
