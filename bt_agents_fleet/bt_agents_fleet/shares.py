# SPDX-License-Identifier: Apache-2.0
"""What the files of a trees folder let a robot share, read again when one of them has changed."""

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
    """Layers of an agent that leave the robot, and are taken from others."""

    PLACES = "place"
    ALL_BUT_PERSONS = "everything"
    ALL = "everything, persons"

    def includes(self, layer: str) -> bool:
        """Return whether a layer is among them; the profile for everybody is one, too."""
        if layer == EVERYBODY:
            return self is not SharedLayers.PLACES
        if layer.startswith(f"{PERSON}/"):
            return self is SharedLayers.ALL
        return layer.startswith(f"{PLACE}/")


class Shares:
    """What is shared of each agent of a trees folder.

    Layers of persons are where ``scene.yaml`` says so, too. An agent whose file is broken, or
    gone, is left out: nothing of it is shared meanwhile.
    """

    def __init__(self, trees: Path) -> None:
        self._trees = trees
        self._stamps: Mapping[str, Stamp] | None = None
        self._shares: dict[str, SharedLayers] = {}

    def read(self) -> Mapping[str, SharedLayers]:
        """Return agent → what is shared of it, without those of which nothing is.

        Raises:
            BtAgentsError: No agent can be read, as ``scene.yaml`` is broken.
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
