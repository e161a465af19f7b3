# SPDX-License-Identifier: Apache-2.0
"""Source bundle: texts from which another machine can rebuild the agents in force."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass

from bt_agents.host.reload.versions import AgentVersions
from bt_agents_core.field_types import INTERFACE_FOLDERS
from bt_agents_language.files.folder_reader import text_of

HOST = "host.json"
"""Name of the text with the reader's other inputs: robot, language and installed packages."""

MARKET = "market.yaml"

APART = "apart"
"""Folder for texts of single agents, by name, that differ from the texts in force."""

_TYPE = re.compile(rf"\b([a-z][a-z0-9_]*)/(?:{'|'.join(INTERFACE_FOLDERS.values())})/[A-Z]")


@dataclass(frozen=True, kw_only=True)
class SourceBundle:
    """Texts of the agents in force.

    Attributes:
        files: Path relative to the trees folder → text; :data:`HOST` and the paths in
            :data:`APART` are no files of the folder.
        versions: Name of an agent → its version in force.
    """

    files: dict[str, str]
    versions: dict[str, int]


def source_bundle(versions: AgentVersions, has_package: Callable[[str], bool]) -> SourceBundle:
    """Return the texts of the agents in force; bindings depend on the installed packages."""
    trees = versions.trees
    files = {
        path.relative_to(trees.folder).as_posix(): text
        for path, text in versions.texts.items()
        if text is not None
    }
    market = text_of(trees.folder / MARKET)
    if market is not None:
        files[MARKET] = market
    for name in sorted(versions.states, key=lambda one: not versions.is_as_read(one)):
        file = versions.states[name].current.file
        if file.text is None:
            continue
        path, own = file.file.relative_to(trees.folder).as_posix(), versions.texts_apart(name)
        if not own and files.setdefault(path, file.text) == file.text:
            continue
        # It was read with other imports than those in force, or its file holds another agent now.
        own = own or versions.texts
        files |= {
            f"{APART}/{name}/{one.relative_to(trees.folder).as_posix()}": text
            for one, text in {**own, file.file: file.text}.items()
            if text is not None
        }
    named = sorted({package for text in files.values() for package in _TYPE.findall(text)})
    packages = [package for package in named if has_package(package)]
    machine = {"robot": trees.robot, "language": trees.language, "packages": packages}
    files[HOST] = json.dumps(machine)
    in_force = {name: one.current.number for name, one in versions.states.items()}
    return SourceBundle(files=files, versions=in_force)
