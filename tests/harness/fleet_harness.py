# SPDX-License-Identifier: Apache-2.0
"""Robots with ledgers on disk, each synchronised with a real database."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import Share
from bt_agents_fleet.database import FleetDatabase, FleetError
from bt_agents_fleet.fleet_sync import FleetSync
from feedback_node.management.management import ManagementAction
from ledger_fixture import SPACE
from simulated_fleet import Clock, Robot

LIMIT_S = 20.0
"""Longest time of a transaction, enough for a busy machine [s]."""


class FleetRobot:
    """A robot that learns, with the synchronisation of its ledger."""

    def __init__(
        self,
        name: str,
        folder: Path,
        clock: Clock,
        address: str,
        *,
        share: Share = Share.EVERYTHING,
        **fields: Any,
    ) -> None:
        self.path = folder / f"{name}.sqlite"
        clock.now += 0.001  # Two ledgers never begin at the same time.
        self.robot = Robot(name, clock, path=str(self.path), **fields)
        self.shares = {"guide": share}
        self.address = address
        self.feedback_node_is_there = True
        self.documents = 0
        self.database = FleetDatabase(address, name, limit_s=LIMIT_S)
        self.database.join()
        self.restart()

    def restart(self) -> None:
        """Restart the process that synchronises."""
        self.database.close()
        self.sync = FleetSync(
            self.robot.name,
            SPACE,
            self.path,
            self.database,
            self._deliver,
            lambda: self.shares,
            wall=self.robot.clock,
        )

    def _deliver(self, document: str) -> str:
        if not self.feedback_node_is_there:
            raise BtAgentsError("the feedback node is away")
        self.documents += 1
        return self.robot.manage(ManagementAction.IMPORT, document=document).document

    def close(self) -> None:
        self.database.close()
        self.robot.ledger.close()


def synchronise(*robots: FleetRobot) -> None:
    """Let all of them push, then all of them pull; retry after a lost connection."""
    for _ in range(2):
        for one in robots:
            try:
                one.sync.cycle()
            except FleetError:
                one.sync.cycle()
