# SPDX-License-Identifier: Apache-2.0
"""Synchronisation of one robot with the database of its fleet until it is interrupted."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

from bt_agents_core.errors import BtAgentsError, Refused, RefusedElsewhere
from bt_agents_core.private_files import open_private
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import printable_line
from bt_agents_fleet.database import FleetDatabase, FleetError
from bt_agents_fleet.fleet_settings import STATUS_FILE, read_settings, write_private
from bt_agents_fleet.fleet_sync import FleetSync
from bt_agents_fleet.shares import Shares
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.client.system_client import SystemClient
from bt_agents_tools.launcher.domain_lock import current_domain, turn_to_join

_LOCK_FILE = "fleet.lock"
_POLL_S = 1.0
_FIND_S = 3.0
_FIRST_RETRY_S = 0.5
_LAST_RETRY_S = 5.0


def keep_up(
    trees: Path, state: Path, ledger: Path, say: Callable[[str], None], interrupt: Interrupt
) -> None:
    """Keep a robot up to date until an interrupt, in one process per state folder at a time.

    Args:
        trees: The trees folder.
        state: Its state folder.
        ledger: Ledger file of the feedback node.
        say: Called with one line at each change of its state.
        interrupt: Set to end it.

    Raises:
        BtAgentsError: The robot has not joined, or its files are unreadable.
    """
    settings = read_settings(state)
    said: str | None = None

    def tell(problem: str) -> None:
        nonlocal said
        if problem != said:
            say(printable_line(problem) or "up to date")
            said = problem

    with ExitStack() as opened:
        lock = open_private(state / _LOCK_FILE, os.O_RDWR | os.O_NOFOLLOW)
        opened.callback(os.close, lock)
        database = FleetDatabase(settings.address, settings.robot)
        opened.callback(database.close)
        with turn_to_join(current_domain()):
            client = SystemClient()
        opened.callback(client.close)
        sync = FleetSync(
            settings.robot,
            read_scene(trees / "scene.yaml").space.profiles,
            ledger,
            database,
            partial(_deliver, client),
            Shares(trees).read,
            wall=time.time,
        )
        _wait_for_turn(lock, tell, interrupt)
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
            write_private(state / STATUS_FILE, sync.status.to_json(), durable=False)
            tell(problem)
            if problem:
                _sleep(pause_s, interrupt)
                continue
            with suppress(FleetError):
                database.wait(_POLL_S)


def _wait_for_turn(lock: int, tell: Callable[[str], None], interrupt: Interrupt) -> None:
    while not interrupt:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            waiting = Refused(
                RefusalCode.FLEET_RUNS,
                "another process keeps this robot up to date; this one goes on when that ends",
            )
            tell(str(waiting))
            _sleep(_POLL_S, interrupt)


def _deliver(client: SystemClient, document: str) -> str:
    """Send a document to the feedback node; return the document of its answer.

    Raises:
        BtAgentsError: There is no answer.
        RefusedElsewhere: The feedback node does not accept it.
    """
    answer = client.ask(
        "feedback/manage", find_s=_FIND_S, action="IMPORT", author="fleet", document=document
    )
    if answer is None:
        raise BtAgentsError("the feedback node is away; what the others have learned waits")
    if not answer.accepted:
        raise RefusedElsewhere(answer.code, answer.message)
    return str(answer.document)


def _sleep(seconds: float, interrupt: Interrupt) -> None:
    end = time.monotonic() + seconds
    while not interrupt and time.monotonic() < end:
        time.sleep(0.05)
