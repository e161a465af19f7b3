# SPDX-License-Identifier: Apache-2.0
"""Lookup of folders: of data the named one, else one in the current folder, else the installed."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from bt_agents_core.errors import BtAgentsError

SHIPPED = "shipped"
"""Name by which the trees folder of the installation is asked for."""


def find_trees(explicit: str = "") -> Path:
    """Return the trees folder: ``explicit``, else this one, ``./trees`` or the installed one.

    Raises:
        BtAgentsError: There is no such folder, or it has no ``scene.yaml``.
    """
    if explicit == SHIPPED:
        return _find("/nowhere", "", "bt_agents_trees", "scene.yaml")
    if not explicit and Path("scene.yaml").is_file():
        return Path()
    return _find("trees", explicit, "bt_agents_trees", "scene.yaml")


def enclosing_folder(path: Path) -> Path:
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


def find_experiments(name: str) -> tuple[Path, ...]:
    """Return the folders of an experiment: a path, else of ``./experiments`` or the installed.

    An experiment of several parts has a folder for each: ``2`` is all of ``2-*``.

    Raises:
        BtAgentsError: There is no such experiment.
    """
    if "/" in name or (Path(name) / "experiment.yaml").exists():
        return (_find("", name, "", "experiment.yaml"),)
    root = experiments_folder()
    known = sorted(path.parent for path in root.glob("*/experiment.yaml"))
    found = tuple(folder for folder in known if folder.name == name)
    found = found or tuple(folder for folder in known if folder.name.startswith(f"{name}-"))
    if not found:
        raise BtAgentsError(
            f"no experiment '{name}'; there are {', '.join(folder.name for folder in known)}, or "
            "name a folder that holds an experiment.yaml"
        )
    return found


def find_sweep(name: str) -> Path:
    """Return the file of a sweep: a path, else of ``./experiments/sweeps`` or the installed.

    Raises:
        BtAgentsError: There is no such sweep.
    """
    if Path(name).is_file():
        return Path(name)
    folder = experiments_folder() / "sweeps"
    found = folder / f"{name}.yaml"
    if "/" in name or not found.is_file():
        known = ", ".join(sorted(path.stem for path in folder.glob("*.yaml")))
        raise BtAgentsError(f"no sweep '{name}'; there are {known}, or name a file")
    return found


def experiments_folder() -> Path:
    """Return the folder of all experiments: ``./experiments`` or the installed one.

    Raises:
        BtAgentsError: There is none.
    """
    return _find("experiments", "", "bt_agents_experiments", "")


def state_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of logs, journals and learned profiles, by the XDG rules.

    Raises:
        BtAgentsError: Neither the environment nor the system knows a home of the user.
    """
    if base := environment.get("XDG_STATE_HOME"):
        return Path(base) / "bt-agents"
    try:
        return Path.home() / ".local" / "state" / "bt-agents"
    except RuntimeError:
        raise BtAgentsError(
            "no place for logs and learned profiles: neither HOME nor XDG_STATE_HOME is set; set "
            "XDG_STATE_HOME to a folder that can be written"
        ) from None


def journal_folder() -> Path:
    """Return the folder of the journal when no other is named."""
    return state_folder() / "journal"


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
