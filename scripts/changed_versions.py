# SPDX-License-Identifier: Apache-2.0
"""Versions in lock files of this checkout that differ from the last commit."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def versions(file: str, text: str) -> dict[str, str]:
    """Return the versions of all packages in a lock file of uv or npm."""
    if file.endswith(".json"):
        packages = json.loads(text)["packages"].items()
        found = [(name.rpartition("node_modules/")[2], one) for name, one in packages if name]
    else:
        found = [(one["name"], one) for one in tomllib.loads(text)["package"]]
    every: dict[str, set[str]] = {}
    for name, one in found:
        every.setdefault(name, set()).add(one.get("version", ""))
    return {name: ", ".join(sorted(several)) for name, several in every.items()}


def changes(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """Return a line for each package with a changed version."""
    return [
        f"{name} {before.get(name, 'none')} → {after.get(name, 'none')}"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]


def main(files: list[str]) -> None:
    """Print the changes of some files; their paths are relative to the root of the checkout."""
    for file in files:
        committed = subprocess.run(
            ["git", "show", f"HEAD:{file}"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        now = (ROOT / file).read_text(encoding="utf-8")
        for line in changes(versions(file, committed), versions(file, now)):
            print(f"{file}: {line}")


if __name__ == "__main__":
    main(sys.argv[1:])
