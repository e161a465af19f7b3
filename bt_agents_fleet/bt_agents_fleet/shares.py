# SPDX-License-Identifier: Apache-2.0
"""Layers that a robot may share according to its trees folder, read again after changes."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path

from bt_agents_core.feedback import Share
from bt_agents_core.file_watch import Stamp, poll
from bt_agents_core.profile_layers import EVERYBODY, PERSON, PLACE
from bt_agents_language.files.folder_reader import read_trees

_SUFFIXES = (".yaml", ".yml")


class SharedLayers(StrEnum):
    """Layers of an agent that the robot shares with others."""

    PLACES = "place"
    ALL_BUT_PERSONS = "everything"
    ALL = "everything, persons"

    def includes(self, layer: str) -> bool:
        """Return whether a layer is shared; the profile for everybody is a layer, too."""
        if layer == EVERYBODY:
            return self is not SharedLayers.PLACES
        if layer.startswith(f"{PERSON}/"):
            return self is SharedLayers.ALL
        return layer.startswith(f"{PLACE}/")


class Shares:
    """Shared layers of each agent in a trees folder.

    Layers of persons are shared only if ``scene.yaml`` also allows it. An agent with a broken or
    missing file shares nothing meanwhile.
    """

    def __init__(self, trees: Path) -> None:
        self._trees = trees
        self._stamps: Mapping[str, Stamp] | None = None
        self._shares: dict[str, SharedLayers] = {}

    def read(self) -> Mapping[str, SharedLayers]:
        """Return the shared layers of each agent that shares any.

        Raises:
            BtAgentsError: No agent can be read, because ``scene.yaml`` is broken.
        """
        stamps = poll([self._trees], _SUFFIXES)
        if stamps != self._stamps:
            trees = read_trees(self._trees)
            persons = trees.scene.shares_persons
            layers = {
                Share.PLACE: SharedLayers.PLACES,
                Share.EVERYTHING: SharedLayers.ALL if persons else SharedLayers.ALL_BUT_PERSONS,
            }
            self._shares = {
                agent.name: layers[agent.learning.share]
                for agent in trees.agents
                if agent.learning.share in layers
            }
            self._stamps = stamps
        return self._shares
