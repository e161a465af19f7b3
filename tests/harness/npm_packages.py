# SPDX-License-Identifier: Apache-2.0
"""Packages of npm that tests need, fetched once into a cache."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from checkout import ROOT

INSTALL_S = 240
_LOCKED = ROOT / "tests" / "npm"


class NotFetched(Exception):
    """A package is not to be had here, for the reason given."""


def program(name: str) -> str:
    """Return the path of ``node`` or ``npm``, of the environment or of the machine.

    Raises:
        NotFetched: There is none.
    """
    beside = Path(sys.executable).parent
    found = shutil.which(name, path=f"{beside}{os.pathsep}{os.environ.get('PATH', '')}")
    if found is None:
        raise NotFetched(f"there is no {name} here")
    return found


def node_environment() -> dict[str, str]:
    """Return an environment in which ``npm`` finds the ``node`` that belongs to it."""
    folder = Path(program("node")).parent
    return {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ.get('PATH', '')}"}


def npm(*arguments: str, folder: Path) -> None:
    """Run npm in a folder.

    Raises:
        NotFetched: It fails. What it says may name the registry of this machine, and is left out.
    """
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
        raise NotFetched(f"npm {arguments[0]} did not end within {INSTALL_S} s") from None
    if done.returncode:
        raise NotFetched(f"npm {' '.join(arguments)} failed (exit {done.returncode})")


def installed_packages() -> Path:
    """Return the folder ``node_modules`` with the packages that ``tests/npm`` locks.

    Raises:
        NotFetched: There is no node or npm, or the packages cannot be fetched.
    """
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    cache = Path(home) / "bt-agents" / "npm"
    locked = [_LOCKED / "package.json", _LOCKED / "package-lock.json"]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in locked)).hexdigest()
    folder = cache / digest[:12]
    if not folder.exists():
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as half:
            made = Path(half) / "packages"
            made.mkdir()
            for path in locked:
                shutil.copy(path, made)
            npm("ci", "--ignore-scripts", folder=made)
            # Only what is complete gets the name, also when two tests fetch at once.
            with contextlib.suppress(OSError):
                made.rename(folder)
    return folder / "node_modules"
