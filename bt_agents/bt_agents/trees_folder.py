# SPDX-License-Identifier: Apache-2.0
"""Where the data of a project lies: named, in the current folder, or as installed."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from bt_agents.errors import BtAgentsError


def find_trees(explicit: str = "") -> Path:
    """Return the trees folder: ``explicit``, else this one, ``./trees`` or the installed one.

    Raises:
        BtAgentsError: There is no such folder, or it has no ``scene.yaml``.
    """
    if not explicit and Path("scene.yaml").is_file():
        return Path()
    return _find("trees", explicit, "bt_agents_trees", "scene.yaml")


def folder_around(path: Path) -> Path:
    """Return the trees folder that a file or folder lies in, short when it is below this one.

    Raises:
        BtAgentsError: It lies in none.
    """
    here, inside = Path.cwd(), path.absolute()
    for folder in (inside, *inside.parents):
        if (folder / "scene.yaml").is_file():
            return folder.relative_to(here) if folder.is_relative_to(here) else folder
    raise BtAgentsError(
        f"'{path}' lies in no trees folder: no folder above it has a scene.yaml; put agents and "
        "their tests into trees/agents, skills into trees/skills"
    )


def find_experiment(name: str) -> Path:
    """Return the folder of an experiment: a path, else one of ``./experiments`` or the installed.

    Raises:
        BtAgentsError: There is no such experiment.
    """
    explicit = name if "/" in name or (Path(name) / "experiment.yaml").exists() else ""
    if explicit:
        return _find("", explicit, "", "experiment.yaml")
    root = _find("experiments", "", "bt_agents_experiments", "")
    if not (root / name / "experiment.yaml").is_file():
        known = sorted(path.parent.name for path in root.glob("*/experiment.yaml"))
        raise BtAgentsError(
            f"no experiment '{name}'; there are {', '.join(known)}, or name a folder that holds "
            "an experiment.yaml"
        )
    return root / name


def _find(local: str, explicit: str, package: str, proof: str) -> Path:
    if explicit:
        folder = Path(explicit)
        if not (folder / proof).exists():
            raise BtAgentsError(f"'{folder}' is no such folder: it has no {proof}")
        return folder
    if (Path(local) / proof).exists():
        return Path(local)
    # A ROS workspace names its prefixes; a wheel installs into that of the environment.
    prefixes = [
        *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)),
        sys.prefix,
    ]
    for prefix in prefixes:
        folder = Path(prefix) / "share" / package
        if (folder / proof).exists():
            return folder.resolve()
    raise BtAgentsError(
        f"no folder '{local}' here and no package {package} installed; run this in a checkout, or "
        "install bt-agents"
    )
