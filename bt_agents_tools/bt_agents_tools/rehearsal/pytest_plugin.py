# SPDX-License-Identifier: Apache-2.0
"""Pytest plug-in for the test files of agents: one item per case, without robot and ROS."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.trees_folder import enclosing_folder

# Import the rest only for a case, because pytest loads this module in every project.
if TYPE_CHECKING:
    from _pytest._code.code import TerminalRepr, TracebackStyle

    from bt_agents_core.scene import SceneSpace
    from bt_agents_language.files.testing.scenarios import AgentTestCase
    from bt_agents_tools.rehearsal.suite import TreesFolders

_SUFFIXES = (".test.yaml", ".test.yml")
_TEST_KEYS = (re.compile(r"^test:", re.MULTILINE), re.compile(r"^cases:", re.MULTILINE))
_FOLDERS: pytest.StashKey[TreesFolders] = pytest.StashKey()
_MAX_READ_BYTES = 1024 * 1024


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect ``*.test.yaml`` in a trees folder, or with cases for an agent.

    Files of other programs are skipped, but never a file in a trees folder: an error in its first
    lines must not drop its cases silently.
    """
    if file_path.name.endswith(_SUFFIXES) and _is_agent_test(file_path):
        file: AgentTestFile = AgentTestFile.from_parent(parent, path=file_path)
        return file
    return None


def _is_agent_test(path: Path) -> bool:
    with suppress(BtAgentsError):
        if (enclosing_folder(path) / "agents").is_dir():
            return True
    try:
        with path.open("rb") as file:
            text = file.read(_MAX_READ_BYTES).decode("utf-8", "replace")
    except OSError:
        return False
    return all(key.search(text) for key in _TEST_KEYS)


class CaseFailed(Exception):
    """Failure of a case, with its report."""


class AgentTestFile(pytest.File):
    """Collector of one test file."""

    def collect(self) -> Iterable[pytest.Item]:
        from bt_agents_tools.rehearsal.suite import TreesFolders

        folders = self.config.stash.setdefault(_FOLDERS, TreesFolders())
        try:
            test, space = folders.read_test(self.path)
        except BtAgentsError as error:
            raise self.CollectError(str(error)) from None
        for case in test.cases:
            yield AgentCase.from_parent(self, name=case.name, space=space, case=case)


class AgentCase(pytest.Item):
    """Item of one case."""

    def __init__(self, *, space: SceneSpace, case: AgentTestCase, **more: object) -> None:
        super().__init__(**more)  # type: ignore[arg-type]
        self._space = space
        self._case = case

    def runtest(self) -> None:
        from bt_agents_tools.rehearsal.suite import failure, run_case

        result = run_case(self._case.agent, self._space, self._case)
        if not result.passed:
            raise CaseFailed(failure(result))

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: TracebackStyle | None = None
    ) -> str | TerminalRepr:
        # A traceback does not help authors.
        if isinstance(excinfo.value, CaseFailed):
            return str(excinfo.value)
        return super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[Path, int, str]:
        return self.path, self._case.position.line - 1, f"{self._case.agent.name}: {self.name}"
