# SPDX-License-Identifier: Apache-2.0
"""Looks at a ledger that nobody runs, says what is wrong with it, and saves what is good."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from bt_agents_core.errors import Refused
from feedback_node.ledger.commit_marker import Head, HeadFile, head_path
from feedback_node.ledger.ledger_check import (
    CORRUPT,
    Chain,
    LedgerReport,
    check,
    newest,
    read_only,
)
from feedback_node.ledger.ledger_file import LedgerError, damaged, examine_format, unreadable
from feedback_node.ledger.ledger_layout import FORMAT, lay_out
from feedback_node.ledger.ledger_rows import (
    COLUMNS,
    FORGOTTEN,
    INSERT,
    Damaged,
    ProfileRevision,
    RevisionCause,
    Row,
    row_of,
)


def inspect(path: str | Path) -> LedgerReport:
    """Check a ledger, which a feedback node may have open, and change nothing.

    Raises:
        LedgerError: It is no ledger of this format: ``LEDGER_UNREADABLE``, ``LEDGER_FOREIGN``,
            ``LEDGER_NEWER``, ``LEDGER_OLD``, or ``LEDGER_CORRUPT`` when it is no database at all.
    """
    if not Path(path).is_file():
        raise LedgerError("LEDGER_UNREADABLE", f"{path}: there is no such file")
    try:
        head = newest(path)
        with read_only(path) as database:
            found = examine_format(database, str(path))
            if found != FORMAT:
                raise LedgerError(
                    "LEDGER_OLD",
                    f"{path}: format {found}; a feedback node rewrites it as format {FORMAT} when "
                    "it is started with it",
                )
            return check(database, head)
    except OSError as error:
        raise LedgerError("LEDGER_UNREADABLE", f"{path}: {error}") from error
    except sqlite3.OperationalError as error:
        raise unreadable(str(path), error) from error
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
        raise damaged(str(path), CORRUPT, str(error)) from error


def recover(path: str | Path, new: str | Path) -> int:
    """Copy the good revisions of a damaged ledger into a new one; return how many there are.

    Those are the first ones, as far as the chain of hashes holds. Where the row is lost that says
    that a layer was forgotten, there is a new one.

    Raises:
        Refused: ``FILE_EXISTS`` for a new file that is there.
        LedgerError: As in :func:`inspect`, or the new one cannot be written.
    """
    target = Path(new)
    if target.exists() or head_path(target).exists():
        raise Refused("FILE_EXISTS", f"{target}: it is there already; choose another name")
    inspect(path)
    try:
        with read_only(path) as old:
            chain = _copy(old, target)
    except sqlite3.Error as error:
        raise unreadable(str(target), error) from error
    except OSError as error:
        raise LedgerError("LEDGER_UNREADABLE", f"{target}: {error}") from error
    return chain.good


def _copy(old: sqlite3.Connection, target: Path) -> Chain:
    chain = Chain()
    head = HeadFile(head_path(target))
    new = sqlite3.connect(target, isolation_level=None)
    try:
        new.execute("PRAGMA journal_mode = WAL")
        new.execute("PRAGMA synchronous = FULL")
        new.execute("BEGIN IMMEDIATE")
        lay_out(new)
        for values in _good(old, chain):
            new.execute(INSERT, values)
        end = Head(number=chain.good, chain=chain.value)
        for layer, (agent, revision, seal) in chain.unsealed.items():
            row = _seal(end, agent, layer, revision, seal.hexdigest())
            new.execute(INSERT, row)
            end = Head(number=row.number, chain=row.chain)
        new.execute("COMMIT")
        head.write(end)
    finally:
        new.close()
        head.close()
    return chain


def _good(old: sqlite3.Connection, chain: Chain) -> Iterator[tuple[Any, ...]]:
    """Yield the rows that the chain can follow."""
    with suppress(Damaged, UnicodeDecodeError, sqlite3.DatabaseError):
        for values in old.execute(f"SELECT {COLUMNS} FROM revision ORDER BY number"):
            chain.follow(values)
            yield values


def _seal(end: Head, agent: str, layer: str, revision: int, seal: str) -> Row:
    cause = RevisionCause(cause=FORGOTTEN, source="recovery", seal=seal)
    told = ProfileRevision(
        agent=agent, layer=layer, revision=revision, profile={}, cause=cause, stamp=time.time()
    )
    return row_of(end.number + 1, told, end.chain)
