# SPDX-License-Identifier: Apache-2.0
"""npm packages for tests, fetched once into a cache; without them a test is skipped."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from checkout import ROOT

INSTALL_S = 240
_LOCKED = ROOT / "tests" / "npm"


def program(name: str) -> str:
    """Return the path of ``node`` or ``npm``, from the environment or the machine."""
    beside = Path(sys.executable).parent
    found = shutil.which(name, path=f"{beside}{os.pathsep}{os.environ.get('PATH', '')}")
    if found is None:
        pytest.skip(f"there is no {name} here")
    return found


def node_environment() -> dict[str, str]:
    """Return an environment in which ``npm`` finds its own ``node``."""
    folder = Path(program("node")).parent
    return {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ.get('PATH', '')}"}


def npm(*arguments: str, folder: Path) -> None:
    """Run npm in a folder; omit its output, which may name the registry of this machine."""
    command = [program("npm"), *arguments, "--no-audit", "--no-fund"]
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=node_environment(),
            capture_output=True,
            timeout=INSTALL_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        pytest.skip(f"npm {arguments[0]} did not end within {INSTALL_S} s")
    if done.returncode:
        pytest.skip(f"npm {' '.join(arguments)} failed (exit {done.returncode})")


def make_once(folder: Path, make: Callable[[Path], None]) -> None:
    """Let a function fill a folder, unless it exists.

    Only a complete folder gets the name, even if two tests make it at once.
    """
    if folder.exists():
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as half:
        made = Path(half) / "made"
        made.mkdir()
        make(made)
        with contextlib.suppress(OSError):
            made.rename(folder)


def installed_packages() -> Path:
    """Return the folder ``node_modules`` with the packages that ``tests/npm`` locks."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    cache = Path(home) / "bt-agents" / "npm"
    locked = [_LOCKED / "package.json", _LOCKED / "package-lock.json"]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in locked)).hexdigest()
    folder = cache / digest[:12]

    def fetch(made: Path) -> None:
        for path in locked:
            shutil.copy(path, made)
        npm("ci", "--ignore-scripts", folder=made)

    make_once(folder, fetch)
    return folder / "node_modules"
