# SPDX-License-Identifier: Apache-2.0
"""Recovery of a damaged ledger: its good rows as a new file."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from bt_agents_core.errors import Refused
from feedback_node.ledger.check import RowCheck
from feedback_node.ledger.file import connect, inspect, open_database, unreadable
from feedback_node.ledger.rows import INSERT


def recover(path: str, new: str) -> int:
    """Copy the good rows of a ledger into a new one; return how many there are.

    Raises:
        Refused: ``FILE_EXISTS`` for a new file that is there.
        LedgerError: As in :func:`inspect`, or the new one cannot be written.
    """
    if Path(new).exists():
        raise Refused("FILE_EXISTS", f"{new}: it is there already; choose another name")
    inspect(path)
    with closing(open_database(new)) as copy:
        try:
            with closing(connect(path, "ro")) as old:
                rows = RowCheck(old)
                copy.execute("BEGIN IMMEDIATE")
                copy.executemany(INSERT, rows.good_rows())
                copy.execute("COMMIT")
        except sqlite3.Error as error:
            raise unreadable(new, error) from error
    return rows.good
