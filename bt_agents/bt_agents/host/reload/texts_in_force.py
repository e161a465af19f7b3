# SPDX-License-Identifier: Apache-2.0
"""Texts of the files that the agents of a host are made from."""

from __future__ import annotations

from bt_agents.host.reload.versions import AgentVersions
from bt_agents_language.files.folder_reader import text_of

MARKET = "market.yaml"

SCENE = "scene.yaml"


def texts_in_force(versions: AgentVersions) -> dict[str, str]:
    """Return path relative to the trees folder → text; of a broken file the last good text."""
    trees = versions.trees
    files = [
        (state.current.file.file, state.current.file.text) for state in versions.states.values()
    ]
    market = trees.folder / MARKET
    found: dict[str, str] = {}
    for path, text in [*versions.texts.items(), *files, (market, text_of(market))]:
        if text is not None:
            found.setdefault(path.relative_to(trees.folder).as_posix(), text)
    return found
