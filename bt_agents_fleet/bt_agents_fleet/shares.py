# SPDX-License-Identifier: Apache-2.0
"""Share of each agent of a trees folder in the fleet's learning, read again after changes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bt_agents_core.feedback import Share
from bt_agents_core.file_watch import Stamp, poll
from bt_agents_core.profile_layers import EVERYBODY, PLACE
from bt_agents_language.files.folder_reader import read_trees

_SUFFIXES = (".yaml", ".yml")


def includes(share: Share, layer: str) -> bool:
    """Return whether a layer is shared; the profile for everybody is a layer, too.

    Layers of persons never leave a robot.
    """
    if layer == EVERYBODY:
        return share is Share.EVERYTHING
    return share is not Share.NOTHING and layer.startswith(f"{PLACE}/")


class Shares:
    """Share of each agent of a trees folder in the fleet's learning.

    An agent with a broken or missing file shares nothing meanwhile.
    """

    def __init__(self, trees: Path) -> None:
        self._trees = trees
        self._stamps: Mapping[str, Stamp] | None = None
        self._shares: dict[str, Share] = {}

    def read(self) -> Mapping[str, Share]:
        """Return what each agent shares, without agents that share nothing.

        Raises:
            BtAgentsError: No agent can be read, because ``scene.yaml`` is broken.
        """
        stamps = poll([self._trees], _SUFFIXES)
        if stamps != self._stamps:
            self._shares = {
                agent.name: agent.learning.share
                for agent in read_trees(self._trees).agents
                if agent.learning.share is not Share.NOTHING
            }
            self._stamps = stamps
        return self._shares
