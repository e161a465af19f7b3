# SPDX-License-Identifier: Apache-2.0
"""Lines of the answer to a reload."""

from __future__ import annotations

from pathlib import Path

from bt_agents.host.reload.reload_service import reload_lines
from bt_agents.host.reload.versions import AgentVersions
from bt_agents_language.files.folder_reader import read_trees
from reload_harness import agent, new_folder, write


def test_pending_and_broken_versions_are_always_reported() -> None:
    assert reload_lines([], "", []) == ["nothing has changed"]
    assert reload_lines([], "version 4 of ann waits", ["a.yaml:1:1: error[x]: y"]) == [
        "version 4 of ann waits for the end of the run; 'bt-agents reload --now' cancels it",
        "a.yaml:1:1: error[x]: y",
    ]


def test_problem_named_by_change_is_reported_once() -> None:
    changed = ["ann: a.yaml is broken, version 3 stays in force: a.yaml:1:1: error[x]: y"]
    assert reload_lines(changed, "", ["a.yaml:1:1: error[x]: y"]) == changed


def test_problem_includes_its_hint(tmp_path: Path) -> None:
    folder = new_folder(tmp_path / "trees")
    write(folder, "ann", agent("ann", "{syy: hi}"))
    [problem] = AgentVersions(read_trees(folder)).folder_problems()
    assert problem.message.endswith("(did you mean 'say'?)")
