# SPDX-License-Identifier: Apache-2.0
"""Synchronisation of one robot with the database of its fleet until it is interrupted."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.private_files import open_private
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import printable_line
from bt_agents_fleet.database import FleetDatabase, FleetError
from bt_agents_fleet.fleet_settings import STATUS_FILE, password_of, read_settings, write_private
from bt_agents_fleet.fleet_sync import FleetSync
from bt_agents_fleet.node import FeedbackClient
from bt_agents_fleet.shares import Shares
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.launcher.domain_lock import current_domain, turn_to_join

_LOCK_FILE = "fleet.lock"
_POLL_S = 1.0
_FIRST_RETRY_S = 0.5
_LAST_RETRY_S = 5.0


class FleetRun:
    """Repeated synchronisation, by one process per state folder at a time.

    Args:
        trees: The trees folder.
        state: Its state folder.
        ledger: Ledger file of the feedback node.
        say: Called with one line at each change of its state.
    """

    def __init__(self, trees: Path, state: Path, ledger: Path, say: Callable[[str], None]) -> None:
        self._trees = trees
        self._state = state
        self._ledger = ledger
        self._say = say
        self._said: str | None = None

    def run(self, interrupt: Interrupt) -> None:
        """Keep the robot up to date until an interrupt.

        Raises:
            BtAgentsError: The robot has not joined, or its files are unreadable.
        """
        settings = read_settings(self._state)
        with ExitStack() as opened:
            lock = open_private(self._state / _LOCK_FILE, os.O_RDWR | os.O_NOFOLLOW)
            opened.callback(os.close, lock)
            database = FleetDatabase(
                settings.address, settings.robot, password=password_of(settings)
            )
            opened.callback(database.close)
            with turn_to_join(current_domain()):
                client = FeedbackClient()
            opened.callback(client.close)
            sync = FleetSync(
                settings.robot,
                read_scene(self._trees / "scene.yaml").space.profiles,
                self._ledger,
                database,
                client.deliver,
                Shares(self._trees).read,
                wall=time.time,
            )
            self._wait_for_turn(lock, interrupt)
            self._keep_up(sync, database, interrupt)

    def _wait_for_turn(self, lock: int, interrupt: Interrupt) -> None:
        while not interrupt:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except BlockingIOError:
                waiting = Refused(
                    RefusalCode.FLEET_RUNS,
                    "another process keeps this robot up to date; this one goes on when that ends",
                )
                self._tell(str(waiting))
                _sleep(_POLL_S, interrupt)

    def _keep_up(self, sync: FleetSync, database: FleetDatabase, interrupt: Interrupt) -> None:
        pause_s = _FIRST_RETRY_S
        while not interrupt:
            try:
                sync.cycle()
                pause_s = _FIRST_RETRY_S
            except FleetError:
                pause_s = min(2 * pause_s, _LAST_RETRY_S)
            except BtAgentsError:
                pause_s = _POLL_S
            problem = sync.status.problem
            write_private(self._state / STATUS_FILE, sync.status.to_json(), durable=False)
            self._tell(problem)
            if problem:
                _sleep(pause_s, interrupt)
                continue
            try:
                database.wait(_POLL_S)
            except FleetError:
                continue

    def _tell(self, problem: str) -> None:
        if problem != self._said:
            self._say(printable_line(problem) or "up to date")
            self._said = problem


def _sleep(seconds: float, interrupt: Interrupt) -> None:
    end = time.monotonic() + seconds
    while not interrupt and time.monotonic() < end:
        time.sleep(0.05)
