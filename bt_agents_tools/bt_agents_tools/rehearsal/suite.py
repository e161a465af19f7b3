# SPDX-License-Identifier: Apache-2.0
"""Test files of agents: discovery, runs and reports."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.scene import SceneSpace
from bt_agents_core.text import printable_lines
from bt_agents_core.trees_folder import enclosing_folder
from bt_agents_language.fields.interfaces import Interfaces, OfInstalledPackages
from bt_agents_language.files.folder_reader import TEST_SUFFIXES, Trees, read_trees
from bt_agents_language.files.testing.scenarios import AgentTest, AgentTestCase
from bt_agents_language.files.testing.test_reader import read_test
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_tools.rehearsal.assertions import AssertionFailure, failed_assertions
from bt_agents_tools.rehearsal.coverage import Coverage, coverage
from bt_agents_tools.rehearsal.events import Rehearsed
from bt_agents_tools.rehearsal.rehearsal import rehearse
from bt_agents_tools.rehearsal.transcript import ending, table, transcript

_NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """Result of one case, with its real duration [s]."""

    case: AgentTestCase
    rehearsed: Rehearsed
    failures: tuple[AssertionFailure, ...]
    elapsed_s: float

    @property
    def passed(self) -> bool:
        """True without failures."""
        return not self.failures


@dataclass(frozen=True, kw_only=True)
class FileResult:
    """Results of the cases of one file; ``error`` is set if it could not be read."""

    file: Path
    agent: AgentSpec | None = None
    cases: tuple[CaseResult, ...] = ()
    error: ReadError | None = None


class TreesFolders:
    """Trees folders of tests, each read once, in a given language or in the scene's."""

    def __init__(self, language: str = "") -> None:
        self._language = language
        self._trees: dict[Path, Trees] = {}

    def trees_of(self, path: Path) -> Trees:
        """Return the trees folder around a file.

        Raises:
            BtAgentsError: It is in none.
            ReadError: The scene or the skills of the folder are broken.
        """
        folder = enclosing_folder(path)
        if folder not in self._trees:
            self._trees[folder] = read_trees(folder, language=self._language)
        return self._trees[folder]

    def read_test(self, path: Path) -> tuple[AgentTest, SceneSpace]:
        """Return a test file and its scene parameters.

        Raises:
            BtAgentsError: As in :meth:`trees_of`.
            ReadError: There is a problem; it lists all of them.
        """
        trees = self.trees_of(path)
        symbols = with_installed_types(trees.symbols)
        return read_test(path, trees.agents, symbols), trees.scene.space


def find_tests(paths: Iterable[Path]) -> list[Path]:
    """Return test files: the named ones, and those anywhere below the named folders.

    Raises:
        BtAgentsError: A path does not exist, or is a file of another kind.
    """
    found: dict[Path, None] = {}
    for path in paths:
        if path.is_dir():
            inside = (one for suffix in TEST_SUFFIXES for one in path.rglob(f"*{suffix}"))
            shown = (one for one in inside if not any(p.startswith(".") for p in one.parts[1:]))
            found |= dict.fromkeys(sorted(shown))
        elif not path.exists():
            raise BtAgentsError(f"there is no file or folder '{path}'")
        elif not path.name.endswith(TEST_SUFFIXES):
            raise BtAgentsError(f"'{path}' is not a test file; its name must end with .test.yaml")
        else:
            found[path] = None
    return list(found)


def run_case(agent: AgentSpec, space: SceneSpace, case: AgentTestCase) -> CaseResult:
    """Rehearse a case and compare it with its expectations."""
    start = time.perf_counter()
    rehearsed = rehearse(agent, space, case.scenario)
    return CaseResult(
        case=case,
        rehearsed=rehearsed,
        failures=failed_assertions(case, rehearsed),
        elapsed_s=time.perf_counter() - start,
    )


def run_file(path: Path, folders: TreesFolders, word: str = "") -> FileResult:
    """Run the cases of a file whose names have ``word`` in them.

    Raises:
        BtAgentsError: The file is in no trees folder.
    """
    try:
        test, space = folders.read_test(path)
    except ReadError as error:
        return FileResult(file=path, error=error)
    chosen = [case for case in test.cases if word.casefold() in case.name.casefold()]
    return FileResult(
        file=path,
        agent=test.agent,
        cases=tuple(run_case(case.agent, space, case) for case in chosen),
    )


def broken_by(paths: Iterable[Path], agents: Mapping[str, AgentSpec]) -> list[FileResult]:
    """Return the test files of agents, with the cases that pass now and fail with other specs.

    The result has every file of one of these agents, by name, even without such a case. Cases
    with their own language are left out, because the other specs use the robot's language.

    Raises:
        BtAgentsError: A file is in no trees folder.
    """
    folders, results = TreesFolders(), []
    for path in paths:
        try:
            test, space = folders.read_test(path)
        except ReadError as error:
            results.append(FileResult(file=path, error=error))
            continue
        agent = agents.get(test.agent.name)
        if agent is None:
            continue
        usual = [case for case in test.cases if case.agent is test.agent]
        failing = (one for one in (run_case(agent, space, c) for c in usual) if one.failures)
        cases = tuple(one for one in failing if run_case(test.agent, space, one.case).passed)
        results.append(FileResult(file=path, agent=agent, cases=cases))
    return results


def coverages(results: Iterable[FileResult]) -> list[Coverage]:
    """Return the coverage of each agent, sorted by name."""
    by_agent: dict[str, tuple[AgentSpec, list[CaseResult]]] = {}
    for result in results:
        if result.agent is not None:
            by_agent.setdefault(result.agent.file, (result.agent, []))[1].extend(result.cases)
    return [
        coverage(agent, (one.rehearsed.marks for one in cases))
        for agent, cases in sorted(by_agent.values(), key=lambda pair: pair[0].name)
    ]


def failure(result: CaseResult) -> str:
    """Return the report of a failed case: its failures side by side, then the transcript."""
    blocks: list[str] = []
    for one in result.failures:
        blocks.append(f"{one.position.file}:{one.position.line}: {printable_lines(one.message)}")
        if one.rows:
            blocks += table(one.rows)
    if blocks and not result.rehearsed.ticks:
        return "\n".join(blocks)
    blocks += ["", f"what happened ({ending(result.rehearsed)}):"]
    blocks.append(transcript(result.rehearsed.events))
    return "\n".join(blocks)


def junit(results: Iterable[FileResult]) -> str:
    """Return results as a JUnit document: a suite per file, a test case per case."""
    root = ElementTree.Element("testsuites", name="bt-agents")
    for result in results:
        failed = sum(not case.passed for case in result.cases)
        suite = ElementTree.SubElement(
            root,
            "testsuite",
            name=str(result.file),
            tests=str(len(result.cases) + (result.error is not None)),
            failures=str(failed),
            errors=str(int(result.error is not None)),
            time=f"{sum(case.elapsed_s for case in result.cases):.3f}",
        )
        if result.error is not None:
            case = ElementTree.SubElement(
                suite, "testcase", name="the file can be read", classname=str(result.file)
            )
            broken = ElementTree.SubElement(case, "error", message=_clean(result.error.lines[0]))
            broken.text = _clean(result.error.report)
        for one in result.cases:
            position = one.case.position
            case = ElementTree.SubElement(
                suite,
                "testcase",
                name=_clean(one.case.name),
                classname=result.agent.name if result.agent is not None else "",
                file=position.file,
                line=str(position.line),
                time=f"{one.elapsed_s:.3f}",
            )
            if one.failures:
                first = one.failures[0].message
                failed_case = ElementTree.SubElement(case, "failure", message=_clean(first))
                failed_case.text = _clean(failure(one))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _clean(text: str) -> str:
    return _NOT_IN_XML.sub("�", text)


def installed_types() -> Interfaces | None:
    """Return the installed ROS types; None without ROS, which leaves types unchecked."""
    try:
        from bt_agents_ros.installed import InstalledInterfaces
    except ImportError:
        return None
    return InstalledInterfaces()


def with_installed_types(symbols: SymbolTable) -> SymbolTable:
    """Return symbols for a rehearsal that checks messages against their types.

    Types of packages that are not installed, such as types of a robot elsewhere, stay unchecked.
    """
    types = installed_types()
    return replace(symbols, interfaces=None if types is None else OfInstalledPackages(types))
