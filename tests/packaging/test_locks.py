# SPDX-License-Identifier: Apache-2.0
"""Lock files: they contain exactly the packages that ``pyproject.toml`` needs."""

from __future__ import annotations

import subprocess
import tomllib
from pathlib import Path

import pytest

from checkout import ROOT
from locked_packages import uv

pytestmark = pytest.mark.packaging


def test_lock_matches_project():
    uv("lock", "--check", "--offline", "--project", str(ROOT))


def test_bootstrap_file_matches_lock():
    exported = ["export", "--project", str(ROOT), "--frozen", "--only-group", "bootstrap"]
    printed = uv(*exported, "--no-annotate", "--no-header", "--quiet")
    assert (ROOT / "scripts" / "uv.txt").read_text() == printed


def test_environment_has_only_locked_versions(requirements: Path):
    lock = tomllib.loads((ROOT / "uv.lock").read_text())
    locked = {f"{one['name']}=={one['version']}" for one in lock["package"]}
    # The ROS wheels contain metadata of packages inside them, which no installer wrote.
    program = (
        "import re\n"
        "from importlib.metadata import distributions\n"
        "for one in distributions():\n"
        "    if one.read_text('INSTALLER'):\n"
        "        print(re.sub('[-_.]+', '-', one.name).lower(), one.version, sep='==')\n"
    )
    installed = subprocess.run(
        [requirements / "bin" / "python", "-I", "-c", program],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert len(installed) > 50
    assert set(installed) <= locked
