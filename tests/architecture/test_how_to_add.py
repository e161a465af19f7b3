# SPDX-License-Identifier: Apache-2.0
"""The additions of docs/how_to_add.md, made and used in a copy of the packages."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

import pytest

from checkout import PYTHON_PACKAGES, ROOT
from npm_packages import node_environment

PAGE = (ROOT / "docs" / "how_to_add.md").read_text(encoding="utf-8")
MOST_FILES = {
    "A leaf": 2,
    "A leaf with a new capability": 6,
    "A decorator": 2,
    "A selection strategy": 2,
    "An option of scene sources": 3,
    "A learning rule": 3,
    "A mood action": 4,
    "A message on the graph": 2,
    "A page of the studio": 4,
    "A command": 2,
    "A diagnostic code": 2,
}
"""Heading of the page → number of product files that such an addition touches."""

COPIED = (*[package.name for package in PYTHON_PACKAGES], "bt_agents_interfaces", "trees")
NEW_FILE = re.compile(r"^`([^`]+)`:\n\n```(?:py|tsx|yml)\n(.*?)^```", re.MULTILINE | re.DOTALL)
DIFF = re.compile(r"^```diff\n(.*?)^```", re.MULTILINE | re.DOTALL)
SESSION = re.compile(r"^```sh\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL)
BT_AGENTS = '#!/bin/sh\nexec "{python}" -S -P -m bt_agents_tools.cli "$@"\n'
TEST = (
    '#!/bin/sh\nexec "{python}" -S -P -m pytest -q -c /dev/null --rootdir . -p no:cacheprovider '
    '--import-mode=importlib "$@"\n'
)


@dataclass(frozen=True, kw_only=True)
class Edit:
    """A change at one place of a file.

    Attributes:
        path: The file.
        before: The lines before the change.
        after: The lines after the change.
    """

    path: str
    before: str
    after: str


def section(heading: str) -> str:
    """Return the text under a heading."""
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def edits(text: str) -> list[Edit]:
    """Return the changes in the diffs of a section."""
    found = []
    for diff in DIFF.findall(text):
        for part in re.split(r"^--- a/", diff, flags=re.MULTILINE)[1:]:
            path, _, hunks = part.partition("\n")
            for hunk in re.split(r"^@@\n", hunks, flags=re.MULTILINE)[1:]:
                lines = hunk.splitlines(keepends=True)
                before, after = (
                    "".join(line[1:] for line in lines if line[0] in marks)
                    for marks in (" -", " +")
                )
                found.append(Edit(path=path, before=before, after=after))
    return found


def touched(text: str) -> list[str]:
    """Return the files of the product that a section adds or changes."""
    paths = {path for path, _ in NEW_FILE.findall(text)} | {one.path for one in edits(text)}
    return sorted(path for path in paths if not path.startswith(("tests/", "trees/")))


def make(text: str, folder: Path) -> None:
    """Make the addition of a section in a folder."""
    for path, content in NEW_FILE.findall(text):
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("x", encoding="utf-8") as new:
            new.write(content)
    for one in edits(text):
        file = folder / one.path
        content = file.read_text(encoding="utf-8")
        assert f"\n{content}".count(f"\n{one.before}") == 1, f"{one.path}:\n{one.before}"
        changed = f"\n{content}".replace(f"\n{one.before}", f"\n{one.after}")
        file.write_text(changed[1:], encoding="utf-8")


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The packages and trees, with the tests of this checkout and programs that use the copy."""
    # Compiled files are as old as their sources, also in a copy.
    ignored = shutil.ignore_patterns("*.so", "build", "node_modules")
    for name in COPIED:
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    shutil.copytree(ROOT / "tests", tmp_path / "tests", ignore=ignored)
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for path, program in (("bin/bt-agents", BT_AGENTS), ("scripts/test", TEST)):
        file = tmp_path / path
        file.parent.mkdir()
        file.write_text(program.format(python=sys.executable))
        file.chmod(0o755)
    return tmp_path


def run(commands: str, folder: Path) -> str:
    """Return the output of a session's commands in a copy, each of which must succeed."""
    # Without the module site, Python searches only these folders.
    folders = [folder / package.name for package in PYTHON_PACKAGES]
    installed = dict.fromkeys(sysconfig.get_path(name) for name in ("purelib", "platlib"))
    script = "set -eo pipefail\n" + re.sub(r"^\$ ", "", commands, flags=re.MULTILINE)
    result = subprocess.run(
        ["bash", "-c", script],
        cwd=folder,
        env={
            **os.environ,
            "PATH": f"{folder / 'bin'}{os.pathsep}{node_environment()['PATH']}",
            "PYTHONPATH": os.pathsep.join(
                [*map(str, folders), str(folder / "tests" / "harness"), *installed]
            ),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "CI": "1",  # hypothesis then takes its time
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stdout
    return result.stdout


def check_style(paths: list[str], folder: Path) -> None:
    """Check that files of a copy have the project's format."""
    for check in (["check"], ["format", "--check"]):
        result = subprocess.run(
            [sys.executable, "-m", "ruff", *check, "--no-cache", *paths],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert result.returncode == 0, result.stdout


def test_page_lists_every_kind_of_addition() -> None:
    headings = re.findall(r"^## (.*)$", PAGE, re.MULTILINE)
    assert headings == list(MOST_FILES)
    for heading in headings:
        assert f"(#{heading.lower().replace(' ', '-')})" in PAGE


@pytest.mark.parametrize("heading", MOST_FILES)
def test_addition_touches_no_more_files_than_allowed(heading: str) -> None:
    assert 0 < len(touched(section(heading))) <= MOST_FILES[heading]


@pytest.mark.parametrize("heading", MOST_FILES)
def test_addition_works_as_documented(heading: str, copy: Path) -> None:
    text = section(heading)
    make(text, copy)
    written = {path for path, _ in NEW_FILE.findall(text)} | {*touched(text)}
    if modules := sorted(path for path in written if path.endswith(".py")):
        check_style(modules, copy)
    sessions = SESSION.findall(text)
    assert sessions
    for commands, output in sessions:
        printed = run(commands, copy)
        assert not output or printed.strip() == output.strip()


def test_copied_checkout_takes_precedence_over_installation(copy: Path) -> None:
    main = copy / "bt_agents_tools" / "bt_agents_tools" / "cli" / "main.py"
    main.write_text('def main(): print("this one")\nmain()\n')
    assert "this one" in run("$ bt-agents", copy)
