# SPDX-License-Identifier: Apache-2.0
"""Lookup of the folders of trees and experiments."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

from bt_agents_core.errors import BtAgentsError

SHIPPED = "shipped"
"""Name that selects the trees folder of the installation."""

_TREES, _TREES_PACKAGE, _SCENE = "trees", "bt_agents_trees", "scene.yaml"
_MOST_SEARCHED = 200
"""Maximum number of folders to search for a suggestion."""


class NoTreesFolderError(BtAgentsError):
    """No trees folder is named, and none is here.

    Attributes:
        near: A nearby one to suggest; None if there is none.
    """

    def __init__(self, near: Path | None) -> None:
        super().__init__(
            f"no trees folder here: neither this folder nor '{_TREES}' in it has a {_SCENE}"
            + (f"; there is one in '{near}'" if near else "")
        )
        self.near = near


def is_trees(folder: Path) -> bool:
    """Return whether a folder is a trees folder; an unreadable one is not."""
    try:
        return (folder / _SCENE).is_file()
    except (OSError, ValueError):
        return False


def find_trees(explicit: str = "") -> Path:
    """Return the trees folder: ``explicit``, else this one or ``./trees``.

    :data:`SHIPPED` names the installation's folder, which is never the default.

    Raises:
        NoTreesFolderError: None is named, and none is here.
        BtAgentsError: There is no such folder, or it has no ``scene.yaml``.
    """
    if explicit == SHIPPED:
        return _installed(_TREES, _TREES_PACKAGE, _SCENE)
    if explicit:
        folder = Path(explicit)
        if is_trees(folder):
            return folder
        near = next(filter(is_trees, (folder / _TREES, *folder.absolute().parents)), None)
        hint = f"did you mean '{near}'?" if near else f"'{SHIPPED}' names the installed one"
        raise BtAgentsError(f"'{folder}' is not a trees folder: it has no {_SCENE}; {hint}")
    for folder in (Path(), Path(_TREES)):
        if is_trees(folder):
            return folder
    raise NoTreesFolderError(next(_near(), None))


def is_installed(path: Path) -> bool:
    """Return whether a file or folder is part of an installation, which must not be edited.

    The trees folder of a checkout is not, although an installation made from it links there.
    """
    inside = path.resolve()
    return any(
        folder.is_dir() and not folder.is_symlink() and inside.is_relative_to(folder.resolve())
        for folder in _shares(_TREES_PACKAGE)
    )


def enclosing_folder(path: Path) -> Path:
    """Return the trees folder of a file or folder, as a short path if below the current one.

    Raises:
        BtAgentsError: It is in none.
    """
    here, inside = Path.cwd(), path.absolute()
    for folder in (inside, *inside.parents):
        if (folder / "scene.yaml").is_file():
            return folder.relative_to(here) if folder.is_relative_to(here) else folder
    raise BtAgentsError(
        f"'{path}' is in no trees folder: no folder above it has a scene.yaml; put agents and "
        "their tests into trees/agents, skills into trees/skills"
    )


def find_experiments(name: str) -> tuple[Path, ...]:
    """Return the folders of an experiment: a path, or one in ``./experiments`` or installed.

    An experiment of several parts has a folder for each: ``2`` is all of ``2-*``.

    Raises:
        BtAgentsError: There is no such experiment.
    """
    named = Path(name)
    if (named / "experiment.yaml").exists():
        return (named,)
    if "/" in name:
        raise BtAgentsError(f"'{named}' is no such folder: it has no experiment.yaml")
    files = [sorted(root.glob("*/experiment.yaml")) for root in _experiment_roots()]
    known = [[file.parent for file in of_root] for of_root in files]
    exact = [[one for one in folders if one.name == name] for folders in known]
    parts = [[one for one in folders if one.name.startswith(f"{name}-")] for folders in known]
    if found := next(filter(None, (*exact, *parts)), None):
        return tuple(found)
    names = dict.fromkeys(folder.name for folders in known for folder in folders)
    raise BtAgentsError(
        f"no experiment '{name}'; there are {', '.join(names)}, or name a folder that holds an "
        "experiment.yaml"
    )


def find_sweep(name: str) -> Path:
    """Return the file of a sweep: a path, or one in ``./experiments/sweeps`` or installed.

    Raises:
        BtAgentsError: There is no such sweep.
    """
    if Path(name).is_file():
        return Path(name)
    known = [path for root in _experiment_roots() for path in sorted(root.glob("sweeps/*.yaml"))]
    found = next((path for path in known if path.stem == name), None)
    if found is None:
        names = ", ".join(dict.fromkeys(path.stem for path in known))
        raise BtAgentsError(f"no sweep '{name}'; there are {names}, or name a file")
    return found


def _experiment_roots() -> tuple[Path, ...]:
    """Return ``./experiments`` and the installed folder of experiments, as far as they exist.

    Raises:
        BtAgentsError: There is neither.
    """
    local = Path("experiments")
    try:
        installed = _installed(str(local), "bt_agents_experiments", "")
    except BtAgentsError:
        if not local.exists():
            raise
        return (local,)
    return (local, installed) if local.exists() else (installed,)


def _installed(local: str, package: str, proof: str) -> Path:
    for folder in _shares(package):
        if (folder / proof).exists():
            return folder.resolve()
    raise BtAgentsError(
        f"no folder '{local}' here and no package {package} installed; run this in a checkout, or "
        "install bt-agents"
    )


def _shares(package: str) -> Iterator[Path]:
    """Yield the folders where the data of a package may be installed."""
    # A ROS workspace names its prefixes; a wheel installs into the environment's.
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    for prefix in (*filter(None, prefixes), sys.prefix):
        yield Path(prefix) / "share" / package


def _near() -> Iterator[Path]:
    """Yield trees folders above this folder, then those in its subfolders."""
    here = Path.cwd()
    above = chain.from_iterable((folder, folder / _TREES) for folder in here.parents)
    beside = chain.from_iterable(
        (folder, folder / _TREES) for folder in islice(sorted(_folders()), _MOST_SEARCHED)
    )
    return filter(is_trees, chain(above, beside))


def _folders() -> Iterator[Path]:
    try:
        yield from (one for one in islice(Path().iterdir(), 10 * _MOST_SEARCHED) if one.is_dir())
    except OSError:
        return
