# SPDX-License-Identifier: Apache-2.0
"""The additions of docs/how_to_add.md, applied and used in a copy of the packages."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from checkout import PYTHON_PACKAGES, ROOT
from npm_packages import node_environment

PAGE = (ROOT / "docs" / "how_to_add.md").read_text(encoding="utf-8")
MOST_FILES = {
    "A leaf": 2,
    "A leaf with a new capability": 6,
    "A decorator": 2,
    "A selection strategy": 1,
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
PATCH = re.compile(r"\]\((how_to_add/\w+\.patch)\)")
SESSION = re.compile(r"^```sh\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL)
BT_AGENTS = '#!/bin/sh\nexec "{python}" -S -P -m bt_agents_tools.cli "$@"\n'
TEST = (
    '#!/bin/sh\nexec "{python}" -S -P -m pytest -q -c /dev/null --rootdir . -p no:cacheprovider '
    '--import-mode=importlib "$@"\n'
)


def section(heading: str) -> str:
    """Return the text under a heading."""
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def patch_of(text: str) -> Path:
    """Return the patch that a section links."""
    (path,) = PATCH.findall(text)
    return ROOT / "docs" / path


def changed(patch: Path) -> list[str]:
    """Return the files that a patch adds or changes."""
    return re.findall(r"^\+\+\+ b/(.*)$", patch.read_text(encoding="utf-8"), re.MULTILINE)


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
            "GIT_CEILING_DIRECTORIES": str(folder.parent),  # else git skips files of a copy
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
    paths = changed(patch_of(section(heading)))
    touched = [path for path in paths if not path.startswith(("tests/", "trees/"))]
    assert 0 < len(touched) <= MOST_FILES[heading]


@pytest.mark.parametrize("heading", MOST_FILES)
def test_addition_works_as_documented(heading: str, copy: Path) -> None:
    text = section(heading)
    patch = patch_of(text)
    run(f"$ git apply {shlex.quote(str(patch))}", copy)
    if modules := [path for path in changed(patch) if path.endswith(".py")]:
        check_style(modules, copy)
    sessions = SESSION.findall(text)
    assert sessions
    for commands, output in sessions:
        printed = run(commands, copy)
        assert not output or printed.strip() == output.strip()
