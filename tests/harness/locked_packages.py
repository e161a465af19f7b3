# SPDX-License-Identifier: Apache-2.0
"""Environments and wheels of tests, made only from packages that ``uv.lock`` names."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from checkout import ROOT

UV = Path(sys.prefix) / "bin" / "uv"
_BUILD_REQUIREMENTS = Path(sys.prefix) / "build-requirements.txt"
_OWN = {"_ROS_WHEELS_BOOTSTRAP_COMPLETE", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "VIRTUAL_ENV"}


def make_environment(folder: Path, *groups: str) -> None:
    """Make an environment with the project's dependencies and groups of ``pyproject.toml``."""
    chosen = [option for group in groups for option in ("--group", group)]
    locked = ["sync", "--project", str(ROOT), "--frozen", "--no-install-project"]
    uv(*locked, "--python", sys.executable, *chosen, UV_PROJECT_ENVIRONMENT=str(folder))


def build_wheel(source: Path, folder: Path, limit_s: float, *options: str) -> Path:
    """Build the wheel of a project with the locked build requirements.

    Raises:
        CalledProcessError: The build fails.
    """
    constraints = ["--build-constraints", str(_BUILD_REQUIREMENTS), "--require-hashes"]
    built = ["--wheel", "--python", sys.executable, "--out-dir", str(folder), str(source)]
    uv("build", *constraints, *options, *built, limit_s=limit_s)
    [wheel] = folder.glob("*.whl")
    return wheel


def uv(*arguments: str, limit_s: float | None = None, **variables: str) -> str:
    """Return uv's output, run without the paths that a process on ROS wheels passes on.

    Raises:
        CalledProcessError: It fails; a note says why.
    """
    handed_down = {name: value for name, value in os.environ.items() if name not in _OWN}
    own = {"UV_SYSTEM_CERTS": "1", "UV_PYTHON_DOWNLOADS": "never", **variables}
    try:
        done = subprocess.run(
            [str(UV), *arguments],
            env=handed_down | own,
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=True,
        )
    except subprocess.CalledProcessError as error:
        error.add_note(error.stderr[-2000:])
        raise
    return done.stdout
