# SPDX-License-Identifier: Apache-2.0
"""The shipped agents pass their tests, which cover every node and branch."""

from __future__ import annotations

import pytest

from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.model.specs import AgentSpec
from bt_agents_tools.rehearsal.suite import TreesFolders, coverages, failure, run_file
from tree_harness import TREES

FOLDERS = TreesFolders()


@pytest.mark.parametrize("agent", read_trees(TREES).agents, ids=lambda agent: agent.name)
def test_shipped_agent_passes_its_tests_with_full_coverage(agent: AgentSpec) -> None:
    result = run_file(TREES / "agents" / f"{agent.name}.test.yaml", FOLDERS)
    assert result.error is None, result.error.report
    assert not [failure(case) for case in result.cases if not case.passed]
    [coverage] = coverages([result])
    assert not [str(gap) for gap in coverage.gaps]
