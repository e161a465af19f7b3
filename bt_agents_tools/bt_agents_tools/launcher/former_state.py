# SPDX-License-Identifier: Apache-2.0
"""Adoption of what was learned when all trees folders of a user shared one place."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable, Collection
from contextlib import closing
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.state_folder import StateFolder
from feedback_node.ledger.file import LedgerLock, connect, inspect
from feedback_node.ledger.reading import LedgerReader

_LEDGER = "ledger.sqlite"
_DATABASES = (_LEDGER, "tunings.sqlite")
_PRESETS = "presets.yaml"


def adopt_former_state(
    kept: StateFolder, home: Path, agents: Callable[[], Collection[str]]
) -> str:
    """Move the former files of all trees folders into a new state folder, when they are of it.

    They are when each agent that has learned is one of its agents. They are moved once, so no
    other folder gets them; else all is left as it is.

    Args:
        kept: The state folder.
        home: Where the former files lie.
        agents: Returns the agents of the trees folder.

    Returns:
        What was done or has to be, for people; empty when there is nothing.
    """
    ledger = home / _LEDGER
    if not kept.is_new or kept.ledger.exists() or not ledger.is_file():
        return ""
    try:
        others = sorted(_agents_in(ledger) - set(agents()))
        if not others:
            _move(home, kept.path)
            return f"what was learned and tuned before is moved from {home} to {kept.path}"
        reason = f"it has agents that are not in this trees folder, such as {others[0]}"
    except (BtAgentsError, OSError, sqlite3.Error) as error:
        reason = str(error)
    return (
        f"what was learned and tuned before stays in {home}: {reason}. To go on with it here, end "
        f"this and move {', '.join(_DATABASES)} and {_PRESETS} from there to {kept.path}"
    )


def _agents_in(ledger: Path) -> set[str]:
    inspect(str(ledger))
    with closing(connect(str(ledger), "ro")) as database:
        return set(LedgerReader(database, str(ledger)).agents())


def _move(home: Path, place: Path) -> None:
    with closing(LedgerLock(home / _LEDGER)):
        found = [home / name for name in _DATABASES if (home / name).is_file()]
        for file in found:
            _fold_log(file)
        # The ledger goes last: while it is there, its agents say whose the others are.
        for file in (home / _PRESETS, *reversed(found)):
            if file.is_file():
                shutil.move(file, place / file.name)
        os.unlink(home / f"{_LEDGER}.lock")


def _fold_log(file: Path) -> None:
    """Move what a killed writer left in the write-ahead log into the file; nobody else has it."""
    with closing(sqlite3.connect(file, timeout=0, isolation_level=None)) as database:
        busy, _, _ = database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    if busy or Path(f"{file}-wal").exists():
        raise BtAgentsError(f"{file} is in use")
