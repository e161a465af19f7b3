# SPDX-License-Identifier: Apache-2.0
"""`bt-agents test` and the pytest plugin: the cases that they run, output and exit codes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner, Result

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.main import bt_agents
from programs import printed_by
from tree_harness import TREES

AGENT = """
format: 1
agent: porter
profile: {age: 3, familiarity: 3, mood: 3}
tree: {sequence: [say: Hello., {drive: gate 7, on_failure: {say: Sorry.}}]}
"""
GOOD = """
format: 1
test: porter
cases:
  - name: all goes well
    scene: {mood: 3}
    expect: {says: [Hello.], ends: succeeded}
"""
BAD = """\
format: 1
test: porter
cases:
  - name: it apologises
    scene: {mood: 3}
    expect: {says: [Hello., Sorry.]}
"""


@pytest.fixture
def trees(tmp_path: Path) -> Path:
    """A trees folder with one agent."""
    folder = tmp_path / "trees"
    (folder / "agents").mkdir(parents=True)
    (folder / "skills").mkdir()
    for name in ("scene.yaml", "skills/robot.yaml"):
        (folder / name).write_text((TREES / name).read_text())
    (folder / "agents" / "porter.yaml").write_text(AGENT)
    return folder


def write(trees: Path, **tests: str) -> None:
    """Write test files by their names."""
    for name, text in tests.items():
        (trees / "agents" / f"{name}.test.yaml").write_text(text)


def run(*words: object) -> Result:
    """Run the command, as typed."""
    return CliRunner().invoke(bt_agents, ["test", *map(str, words)])


def test_failing_case_shows_details_and_exits_with_1(trees: Path) -> None:
    file = trees / "agents" / "porter.test.yaml"
    file.write_text(BAD)
    result = run(file)
    assert result.exit_code == 1
    assert f"{file}:6: says: 1 missing" in result.output
    assert "✘ Sorry." in result.output
    assert '0.0 s  ▶ say "Hello."' in result.output
    assert "1 case: 0 passed, 1 failed" in result.output


def test_broken_file_does_not_stop_other_files(trees: Path) -> None:
    write(trees, a=BAD.replace("says:", "sais:"), b=GOOD)
    result = run(trees)
    assert result.exit_code == 1
    assert "error[unknown-key]: 'expect' has no key 'sais'" in result.output
    assert "1 passed, 1 file with errors" in result.output


def test_keyword_selects_cases(trees: Path) -> None:
    write(trees, a=GOOD, b=BAD)
    assert run(trees, "-k", "WELL").exit_code == 0
    assert isinstance(run(trees, "-k", "nothing").exception, BtAgentsError)


def test_coverage_and_events_are_shown_on_request(trees: Path) -> None:
    write(trees, a=GOOD)
    result = run(trees, "--coverage", "--verbose")
    handler = "tree/1.drive@on_failure/0.say"
    assert f"never ticked: {handler} ({trees / 'agents' / 'porter.yaml'}:5)" in result.output
    assert "80 % porter  4 of 5" not in result.output
    assert " % porter " in result.output
    assert "▶ drive gate 7" in result.output


def test_junit_report_is_readable_by_build_servers(trees: Path, tmp_path: Path) -> None:
    write(trees, a=GOOD, b=BAD, c="format: 1")
    run(trees, "--junit", tmp_path / "junit.xml")
    root = ElementTree.parse(tmp_path / "junit.xml").getroot()
    suites = {Path(suite.attrib["name"]).name[0]: suite.attrib for suite in root}
    assert [suites[name]["failures"] for name in "abc"] == ["0", "1", "0"]
    assert suites["c"]["errors"] == "1"
    [failed] = root.iter("failure")
    assert failed.attrib["message"].startswith("says: 1 missing")
    assert "what happened" in (failed.text or "")
    assert {case.attrib["classname"] for case in root[0]} == {"porter"}


@pytest.mark.parametrize(
    ("name", "words"),
    [("nowhere", "there is no file or folder"), ("scene.yaml", "is not a test file")],
)
def test_path_without_tests_is_refused(trees: Path, name: str, words: str) -> None:
    assert words in str(run(trees / name).exception)


def test_test_outside_trees_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.test.yaml").write_text(GOOD)
    assert "no folder above it has a scene.yaml" in str(run(tmp_path).exception)


def test_empty_test_run_is_not_success(trees: Path) -> None:
    assert "docs/testing.md" in str(run(trees).exception)


def test_pytest_runs_each_case_with_same_report(trees: Path) -> None:
    broken = "format: 1\ntest: porter\ncases: 3\n"
    write(trees, a=GOOD, b=BAD, c=broken, d=GOOD.replace("test: ", "tset: "))
    (trees.parent / "other.test.yaml").write_text("suite: something of another program\n")
    plugins = ("-p", "bt_agents_tools.rehearsal.pytest_plugin", "-p", "no:cacheprovider")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *plugins, "-v", "--continue-on-collection-errors"],
        cwd=trees.parent,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "COLUMNS": "100"},
        check=False,
    )
    assert "agents/a.test.yaml::all goes well PASSED" in done.stdout
    assert "agents/b.test.yaml::it apologises FAILED" in done.stdout
    assert "says: 1 missing" in done.stdout
    assert "what happened" in done.stdout
    assert "Traceback" not in done.stdout
    assert "'cases': expected a list, found '3'" in done.stdout
    assert "tset" in done.stdout
    assert "did you mean 'test'?" in done.stdout
    assert "other.test.yaml" not in done.stdout
    assert done.returncode == 1


def test_pytest_plugin_loads_neither_ros_nor_engine() -> None:
    loaded = printed_by(
        "import sys, bt_agents_tools.rehearsal.pytest_plugin; "
        "print([m for m in ('rclpy', 'py_trees', 'yaml', 'rich') if m in sys.modules])"
    )
    assert loaded == ["[]"]


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("tree/1", "did you mean 'tree/1.say'?"),
        ("tree/9", "possible here: tree/0.drive, tree/1.say"),
    ],
)
def test_unknown_path_suggests_sibling_paths(trees: Path, path: str, hint: str) -> None:
    tree = "tree: {sequence: [{drive: gate 4}, {say: Hello.}]}\n"
    (trees / "agents" / "porter.yaml").write_text(AGENT.partition("tree:")[0] + tree)
    write(trees, porter=BAD.replace("says: [Hello., Sorry.]", f"visited: {path}"))
    output = run(trees).output
    assert "unknown-path" in output
    assert hint in output
