# SPDX-License-Identifier: Apache-2.0
"""Queries of the ledger; reading a row checks its checksum."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import join_first
from feedback_node.ledger.file import damaged, unread
from feedback_node.ledger.rows import (
    AUTHORED,
    COLUMNS,
    FEEDBACK,
    FLEET,
    FORGOTTEN_LAYER,
    Damaged,
    ProfileRevision,
    Row,
    hidden,
    name_of,
    read_row,
)

_FIRST_BATCH = 32
_LARGEST_BATCH = 1024
"""Number of rows in the first and in the largest batch when reading backwards."""

_MOST_STEPS = 1000
"""Most fleet steps and feedbacks with ``SET`` that :meth:`taught` skips."""


class LedgerReader:
    """Queries of an open ledger; each may raise ``LEDGER_CORRUPT`` or ``LEDGER_UNREADABLE``."""

    def __init__(self, database: sqlite3.Connection, path: str) -> None:
        self._database = database
        self._authored: dict[str, Mapping[str, float]] = {}
        self.path = path

    def current(self, agent: str, layer: str = "") -> ProfileRevision | None:
        """Return the latest revision of an agent; None for an unknown agent."""
        where = "WHERE agent = ? AND layer = ? ORDER BY revision DESC LIMIT 1"
        found = self._select(where, agent, layer)
        return found[0] if found else None

    def layers(self, agent: str) -> tuple[ProfileRevision, ...]:
        """Return the latest revision of each layer of an agent, sorted by name."""
        where = (
            "JOIN (SELECT layer AS l, max(revision) AS r FROM revision WHERE agent = ? AND "
            "layer > '' GROUP BY layer) ON layer = l AND revision = r "
            f"WHERE agent = ? AND layer NOT LIKE '{FORGOTTEN_LAYER}%' ORDER BY layer"
        )
        return tuple(self._select(where, agent, agent))

    def count_layers(self, agent: str) -> int:
        """Return the number of layers of an agent."""
        where = f"agent = ? AND layer > '' AND layer NOT LIKE '{FORGOTTEN_LAYER}%'"
        query = f"SELECT count(DISTINCT layer) FROM revision WHERE {where}"
        return int(self._query(query, agent)[0][0])

    def has_layers(self) -> bool:
        """Return whether any agent has, or has had, a layer."""
        return bool(self._query("SELECT 1 FROM revision WHERE layer <> '' LIMIT 1"))

    def agents(self) -> tuple[str, ...]:
        """Return the sorted names of all agents."""
        found = self._query("SELECT DISTINCT agent FROM revision WHERE layer = '' ORDER BY agent")
        return tuple(str(agent) for (agent,) in found)

    def authored(self, agent: str) -> Mapping[str, float]:
        """Return the last profile of an agent that its author wrote.

        Raises:
            Refused: ``UNKNOWN_AGENT``.
        """
        if agent in self._authored:
            return self._authored[agent]
        # The text only narrows the search: an agent has thousands of revisions, few are authored.
        where = "WHERE agent = ? AND layer = '' AND instr(content, ?) ORDER BY revision DESC"
        for row in self._select(where, agent, f'"{AUTHORED}"'):
            if row.cause.cause == AUTHORED:
                self._authored[agent] = row.cause.target
                return row.cause.target
        raise Refused(
            RefusalCode.UNKNOWN_AGENT, f"the ledger has no agent '{agent}'; enter it first"
        )

    def find_all(self, feedback_id: str) -> tuple[ProfileRevision, ...]:
        """Return all revisions that a feedback led to, in order of entry."""
        where = "WHERE feedback_id IN (?, ?) ORDER BY number"
        return tuple(self._select(where, feedback_id, hidden(feedback_id)))

    def count(self, prefix: str) -> dict[str, int]:
        """Return agent → number of its feedbacks whose id has the prefix."""
        query = (
            "SELECT agent, count(DISTINCT feedback_id) FROM revision "
            "WHERE feedback_id >= ? AND feedback_id < ? GROUP BY agent"
        )
        found = self._query(query, prefix, prefix + chr(sys.maxunicode))
        return {str(agent): int(count) for agent, count in found}

    def history(
        self, agent: str, layer: str = "", *, newest: int | None = None
    ) -> tuple[ProfileRevision, ...]:
        """Return the revisions of an agent, oldest first; all, or only the newest."""
        where = "WHERE agent = ? AND layer = ? ORDER BY revision DESC LIMIT ?"
        found = self._select(where, agent, layer, -1 if newest is None else newest)
        return tuple(reversed(found))

    def taught(self, agent: str, layer: str = "", *, newest: int) -> tuple[ProfileRevision, ...]:
        """Return the newest feedbacks that led to the current profile, oldest first.

        It skips undone feedback and everything before the author, a reset or an import set the
        profile, as well as feedback that sets it and steps of other robots.
        """
        found: list[ProfileRevision] = []
        for row in islice(self._back(agent, layer), newest + _MOST_STEPS):
            if len(found) == newest or row.cause.cause not in (FEEDBACK, FLEET):
                break
            if row.cause.kind != FeedbackKind.SET:
                found.append(row)
        return tuple(reversed(found))

    def entries(
        self, *, after: int = 0, agent: str = "", most: int = -1
    ) -> tuple[tuple[int, ProfileRevision], ...]:
        """Return revisions with their numbers, in order of entry.

        Args:
            after: Number of the last known revision.
            agent: Only revisions of this agent; empty for all.
            most: Largest number of revisions; -1 for all.
        """
        where = f"WHERE number > ? {'AND agent = ?' if agent else ''} ORDER BY number LIMIT ?"
        values = (after, agent, most) if agent else (after, most)
        try:
            query = f"SELECT {COLUMNS} FROM revision {where}"
            found = self._database.execute(query, values).fetchall()
            return tuple((int(row[0]), read_row(Row(*row))) for row in found)
        except (sqlite3.Error, Damaged) as error:
            raise unread(self.path, error) from error

    def checksum(self, number: int) -> int | None:
        """Return the checksum of a row; 0 for a forgotten one, None for a missing one."""
        try:
            query = "SELECT checksum, content IS NULL FROM revision WHERE number = ?"
            found = self._database.execute(query, (number,)).fetchone()
        except sqlite3.Error as error:
            raise unread(self.path, error) from error
        return None if found is None else 0 if found[1] else int(found[0])

    def before(self, revision: ProfileRevision) -> ProfileRevision:
        """Return the previous revision; revision 0 returns itself."""
        number = max(0, revision.revision - 1)
        return self._row(revision.agent, revision.layer, number)

    def _back(self, agent: str, layer: str) -> Iterator[ProfileRevision]:
        """Yield the revisions that led to the current one, from it back to the first."""
        row = self.current(agent, layer)
        near: dict[int, ProfileRevision] = {}
        batch = _FIRST_BATCH
        while row is not None:
            row = self._restored(row)
            yield row
            wanted = row.revision - 1
            if wanted < 0:
                return
            if wanted not in near:
                where = "WHERE agent = ? AND layer = ? AND revision <= ? ORDER BY revision DESC"
                found = self._select(f"{where} LIMIT {batch}", agent, layer, wanted)
                near = {one.revision: one for one in found}
                batch = min(2 * batch, _LARGEST_BATCH)
            row = near[wanted] if wanted in near else self._row(agent, layer, wanted)

    def _restored(self, row: ProfileRevision) -> ProfileRevision:
        restores = row.cause.restores
        return row if restores is None else self._row(row.agent, row.layer, restores)

    def _last(self, agent: str, layer: str) -> ProfileRevision:
        last = self.current(agent, layer)
        if last is None and self.current(agent) is None:
            raise Refused(
                RefusalCode.UNKNOWN_AGENT, f"the ledger has no agent '{agent}'; enter it first"
            )
        if last is None:
            known = join_first(row.layer for row in self.layers(agent)) or "none"
            raise Refused(
                RefusalCode.UNKNOWN_LAYER, f"{agent} has no layer '{layer}'; it has: {known}"
            )
        return last

    def _row(self, agent: str, layer: str, revision: int) -> ProfileRevision:
        where = "WHERE agent = ? AND layer = ? AND revision = ?"
        found = self._select(where, agent, layer, revision)
        if not found:
            raise damaged(
                self.path, [f"revision {revision} of {name_of(agent, layer)} is missing"]
            )
        return found[0]

    def _select(self, where: str, *values: str | int) -> list[ProfileRevision]:
        try:
            found = self._database.execute(f"SELECT {COLUMNS} FROM revision {where}", values)
            return [read_row(Row(*row)) for row in found]
        except (sqlite3.Error, Damaged) as error:
            raise unread(self.path, error) from error

    def _query(self, query: str, *values: str) -> list[Any]:
        try:
            return self._database.execute(query, values).fetchall()
        except sqlite3.Error as error:
            raise unread(self.path, error) from error
