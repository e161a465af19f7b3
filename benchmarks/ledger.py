# SPDX-License-Identifier: Apache-2.0
"""How long durable changes of profiles take, beside bare SQLite on the same disk."""

from __future__ import annotations

import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from typing import TypeVar

from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.file import inspect
from feedback_node.ledger.rows import (
    COLUMNS,
    INSERT,
    LAYER,
    ProfileRevision,
    RevisionCause,
    create_tables,
    row_of,
)
from measuring import COLD, HOT, PAUSE_S, Effort, Row, in_turn

ROOT = Path(__file__).parents[1]
AGENTS = 20
PROFILE = {"age": 1.0, "familiarity": 2.0, "mood": 3.0}
REVISIONS = 100_000
BATCH = 1000
COMMITS = 50
COLD_COMMITS = 20
TURNS = 20
"""Times as many measurements as elsewhere: a disk is quick now and slow then."""

GOAL = 0.8
OURS = "bt-agents"
BARE = "bare SQLite"
T = TypeVar("T")


def measure(effort: Effort) -> Iterator[Row]:
    """Compare commits, then what is asked of a large ledger."""
    build = ROOT / "build"
    build.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=build) as folder:
        yield from _commits(Path(folder), effort)
        yield from _large(Path(folder) / "large.sqlite", effort)


def _commits(folder: Path, effort: Effort) -> Iterator[Row]:
    numbers = count(1)
    path = folder / "ledger.sqlite"
    with Ledger(path) as ledger, closing(_bare(folder / "bare.sqlite")) as database:
        ledger.enter({f"agent{number}": PROFILE for number in range(AGENTS)})

        def record(one: LedgerEntry) -> None:
            ledger.record([one])

        def insert(row: tuple[object, ...]) -> None:
            database.execute("BEGIN IMMEDIATE")
            database.execute(INSERT, row)
            database.execute("COMMIT")

        hot, cold = effort.times(COMMITS), effort.times(COLD_COMMITS)
        turns = effort.repetitions * (1 if effort.is_short else TURNS)
        many = replace(effort, repetitions=turns)
        ours, bare = map(entry, numbers), map(_row, numbers)
        ways = {
            OURS: lambda: _rate(record, ours, hot, 0.0),
            BARE: lambda: _rate(insert, bare, hot, 0.0),
        }
        yield _row_of(in_turn(ways, many), HOT)
        ways = {
            OURS: lambda: _rate(record, ours, cold, PAUSE_S),
            BARE: lambda: _rate(insert, bare, cold, PAUSE_S),
        }
        yield _row_of(in_turn(ways, effort), COLD)
        written = many.repetitions * hot + effort.repetitions * cold
    report = inspect(str(path))
    if report.good != AGENTS + written or report.problems:
        raise RuntimeError(f"{written} changes were recorded: {report}")


def _rate(
    commit: Callable[[T], object], changes: Iterator[T], number: int, pause_s: float
) -> float:
    """Return how many commits there are in a second, without what is before each."""
    took = 0.0
    for change in islice(changes, number):
        time.sleep(pause_s)
        began = time.perf_counter()
        commit(change)
        took += time.perf_counter() - began
    return number / took


def _row_of(found: dict[str, list[float]], pace: str) -> Row:
    return Row(
        case="durable changes",
        side=OURS,
        values=found[OURS],
        floor=BARE,
        floor_values=found[BARE],
        unit="/s",
        goal=GOAL,
        at_least=True,
        pace=pace,
        note="the floor writes finished rows of the same size into the same table, with the same "
        "pragmas; ours looks for the id, and makes the row and its checksum",
    )


def _large(path: Path, effort: Effort) -> Iterator[Row]:
    revisions = max(BATCH, effort.times(REVISIONS))
    with Ledger(path) as ledger:
        fill(ledger, revisions)

    def opened() -> float:
        began = time.perf_counter()
        with Ledger(path) as ledger:
            took = time.perf_counter() - began
            if ledger.current("agent0") is None:
                raise RuntimeError("the ledger has lost an agent")
        return took

    def read() -> float:
        with closing(sqlite3.connect(path)) as database:
            began = time.perf_counter()
            rows = database.execute(f"SELECT {COLUMNS} FROM revision ORDER BY number").fetchall()
            database.execute("PRAGMA integrity_check").fetchall()
            if len(rows) != revisions:
                raise RuntimeError(f"{len(rows)} of {revisions} revisions are there")
            return time.perf_counter() - began

    found = in_turn({OURS: opened, BARE: read}, effort)
    yield Row(
        case=f"open and check, {revisions:,} revisions",
        side=OURS,
        values=found[OURS],
        floor="reading, integrity_check",
        floor_values=found[BARE],
        note="ours computes the checksum of each row besides",
    )


def _bare(path: Path) -> sqlite3.Connection:
    """Return a database with the table and the pragmas of a ledger."""
    database = sqlite3.connect(path, isolation_level=None)
    for pragma in ("journal_mode = WAL", "synchronous = FULL", "secure_delete = ON"):
        database.execute(f"PRAGMA {pragma}")
    create_tables(database)
    return database


def _row(number: int) -> tuple[object, ...]:
    one = entry(number)
    return row_of(
        number,
        ProfileRevision(
            agent=one.agent, revision=number, profile=one.profile, cause=one.cause, stamp=0.5
        ),
    )


def fill(ledger: Ledger, revisions: int) -> None:
    """Write revisions, a batch in each transaction."""
    ledger.enter({f"agent{number}": PROFILE for number in range(AGENTS)})
    last = revisions - 2 * AGENTS
    for first in range(0, last, BATCH):
        ledger.record([entry(number) for number in range(first, min(first + BATCH, last))])
    for number in range(AGENTS):
        ledger.append(f"agent{number}", PROFILE, RevisionCause(cause=LAYER), layer="person/anna")


def entry(number: int) -> LedgerEntry:
    """Return what one feedback has taught."""
    agent = f"agent{number % AGENTS}"
    return LedgerEntry(
        agent=agent,
        profile={name: value + number / REVISIONS for name, value in PROFILE.items()},
        cause=RevisionCause(
            kind=1,
            source="mood rule",
            reason="mood.change >= 0.5 held 2 s: mood 3 → 4",
            feedback_id=f"rule/0123456789ab/{number}/{agent}/0",
            epoch="0123456789ab",
            round=number,
            rate=0.2,
            weight=0.5,
            target=PROFILE,
            scene_id=f"scene-{number}",
        ),
    )
