# SPDX-License-Identifier: Apache-2.0
"""The ledger: every revision of every profile with its cause, on disk before it counts."""

from __future__ import annotations

import json
import math
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from bt_agents.errors import Refused
from feedback_node.ledger_file import (
    MEMORY,
    LedgerError,
    corrupt,
    lock_file,
    open_database,
    unreadable,
)

AUTHORED = "authored"
FEEDBACK = "feedback"
UNDO = "undo"

_COLUMNS = (
    "agent, revision, profile, cause, kind, source, reason, feedback_id, epoch, round, rate, "
    "target, scene_id, cancels, restores, stamp"
)


@dataclass(frozen=True, kw_only=True)
class Cause:
    """Why a profile has changed.

    Attributes:
        cause: ``authored``, ``feedback`` or ``undo``.
        kind: Number of the feedback's kind as in ``Feedback.msg``; 0 for no feedback.
        source: Who gave it.
        reason: Why, in words.
        feedback_id: Unique among all feedback; None for a change without feedback.
        epoch: Market of the run; may be empty.
        round: Round of the run; 0 for none.
        rate: Learning rate that was used.
        target: Parameter → value moved towards or away from, without those that had no opinion;
            of an authored revision the profile as its file has it.
        scene_id: Scene of the run; may be empty.
        cancels: True when the run is stopped because of it.
        restores: Of an undo, the revision whose profile it brings back.
    """

    cause: str = FEEDBACK
    kind: int = 0
    source: str = ""
    reason: str = ""
    feedback_id: str | None = None
    epoch: str = ""
    round: int = 0
    rate: float = 0.0
    target: Mapping[str, float] = field(default_factory=dict)
    scene_id: str = ""
    cancels: bool = False
    restores: int | None = None


@dataclass(frozen=True, kw_only=True)
class Revision:
    """One row of the ledger.

    Attributes:
        agent: Whose profile.
        revision: Counts up from 0, the profile that the agent's file began with.
        profile: Parameter → value.
        cause: Why it was written.
        stamp: Wall time of the entry [s].
    """

    agent: str
    revision: int
    profile: Mapping[str, float]
    cause: Cause
    stamp: float


class Ledger:
    """The only writer of one SQLite file; a change is on the disk when its method returns.

    A lock file beside the database keeps a second writer out; readers are welcome at any time.
    """

    def __init__(self, path: str | Path, *, wall: Callable[[], float] = time.time) -> None:
        """Open a ledger; a missing file and its folder are created.

        Args:
            path: SQLite file, or ``":memory:"``.
            wall: Wall time of the entries [s].

        Raises:
            LedgerError: ``LEDGER_UNREADABLE``, ``LEDGER_CORRUPT``, ``LEDGER_FOREIGN``,
                ``LEDGER_NEWER`` or ``LEDGER_IN_USE``; the file is left as it was found.
        """
        self.path = str(path)
        self._wall = wall
        self._lock: TextIO | None = None
        if self.path != MEMORY:
            self._lock = lock_file(Path(self.path))
        try:
            self._database = open_database(self.path)
        except BaseException:
            self._unlock()
            raise

    def tidy(self) -> None:
        """Move what was committed from the write-ahead log into the database file.

        A close would do it otherwise, and on a slow disk outlast the time a process has to stop.
        """
        with suppress(sqlite3.OperationalError):
            self._database.execute("PRAGMA wal_checkpoint(PASSIVE)")

    def close(self) -> None:
        """Close the file and let another writer in; closing twice is fine."""
        self._database.close()
        self._unlock()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def enter(self, profiles: Mapping[str, Mapping[str, float]]) -> dict[str, Revision]:
        """Record what the agents' files say and return the current revision of each.

        A new agent starts at revision 0. Where the author has edited a value since the last
        authored revision, the file's profile becomes a new one, so that the edit wins over what
        was learned before. Where only parameters have come or gone, the learned values stay and
        new parameters take the authored value.

        Args:
            profiles: Agent → parameter → value, as the file has it.

        Raises:
            LedgerError: ``LEDGER_CORRUPT`` or ``LEDGER_FAILED``; nothing is recorded.
        """
        with self._writing():
            return {agent: self._enter(agent, profile) for agent, profile in profiles.items()}

    def append(self, agent: str, profile: Mapping[str, float], cause: Cause) -> Revision:
        """Record a new profile of an agent; a known ``feedback_id`` returns its old revision.

        Raises:
            Refused: ``UNKNOWN_AGENT`` for an agent that was never entered.
            LedgerError: ``LEDGER_CORRUPT`` or ``LEDGER_FAILED``; nothing is recorded.
        """
        with self._writing():
            if cause.feedback_id is not None and (known := self.find(cause.feedback_id)):
                return known
            return self._append(agent, self._last(agent).revision + 1, profile, cause)

    def undo(self, agent: str, *, source: str = "", reason: str = "") -> Revision:
        """Bring back the profile before the last feedback, as a new revision.

        Again and again it goes further back, down to the last profile that the author wrote.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``NOTHING_TO_UNDO``.
            LedgerError: ``LEDGER_CORRUPT`` or ``LEDGER_FAILED``; nothing is recorded.
        """
        with self._writing():
            last = self._last(agent)
            undone = self._restored(last)
            if undone.cause.cause == AUTHORED:
                raise Refused(
                    "NOTHING_TO_UNDO",
                    f"{agent}: revision {undone.revision} is what its file says; "
                    f"edit the profile there",
                )
            back = self._restored(self._row(agent, undone.revision - 1))
            cause = Cause(
                cause=UNDO,
                source=source,
                reason=reason or f"undoes revision {undone.revision}",
                restores=back.revision,
            )
            return self._append(agent, last.revision + 1, back.profile, cause)

    def current(self, agent: str) -> Revision | None:
        """Return the latest revision of an agent; None for an unknown one."""
        rows = self._select("WHERE agent = ? ORDER BY revision DESC LIMIT 1", agent)
        return rows[0] if rows else None

    def find(self, feedback_id: str) -> Revision | None:
        """Return the revision that a feedback led to; None for a new id."""
        rows = self._select("WHERE feedback_id = ?", feedback_id)
        return rows[0] if rows else None

    def count(self, prefix: str) -> dict[str, int]:
        """Return agent → how many of its revisions have a feedback id that begins so."""
        where = "WHERE substr(feedback_id, 1, length(?1)) = ?1"
        counts: dict[str, int] = {}
        for revision in self._select(where, prefix):
            counts[revision.agent] = counts.get(revision.agent, 0) + 1
        return counts

    def history(self, agent: str) -> tuple[Revision, ...]:
        """Return all revisions of an agent, oldest first."""
        return tuple(self._select("WHERE agent = ? ORDER BY revision", agent))

    def before(self, revision: Revision) -> Revision:
        """Return the revision that came before one; revision 0 comes before itself."""
        return self._row(revision.agent, max(0, revision.revision - 1))

    def _enter(self, agent: str, authored: Mapping[str, float]) -> Revision:
        last = self.current(agent)
        cause = Cause(cause=AUTHORED, source="file", reason="first seen", target=authored)
        if last is None:
            return self._append(agent, 0, authored, cause)
        written = self._select(
            "WHERE agent = ? AND cause = ? ORDER BY revision DESC LIMIT 1", agent, AUTHORED
        )[0].cause.target
        edited = [name for name in authored if name in written and authored[name] != written[name]]
        if not edited and authored.keys() == written.keys():
            return last
        if edited:
            profile = authored
            reason = f"the author changed {', '.join(edited)}"
        else:
            profile = {name: last.profile.get(name, value) for name, value in authored.items()}
            reason = "scene parameters were added or removed"
        cause = Cause(cause=AUTHORED, source="file", reason=reason, target=authored)
        return self._append(agent, last.revision + 1, profile, cause)

    def _restored(self, row: Revision) -> Revision:
        restores = row.cause.restores
        return row if restores is None else self._row(row.agent, restores)

    def _last(self, agent: str) -> Revision:
        last = self.current(agent)
        if last is None:
            raise Refused("UNKNOWN_AGENT", f"the ledger has no agent '{agent}'; enter it first")
        return last

    def _row(self, agent: str, revision: int) -> Revision:
        rows = self._select("WHERE agent = ? AND revision = ?", agent, revision)
        if not rows:
            raise corrupt(self.path, f"revision {revision} of {agent} is not there")
        return rows[0]

    def _append(
        self, agent: str, number: int, profile: Mapping[str, float], cause: Cause
    ) -> Revision:
        row = Revision(
            agent=agent, revision=number, profile=dict(profile), cause=cause, stamp=self._wall()
        )
        self._database.execute(
            f"INSERT INTO revision ({_COLUMNS}) VALUES ({', '.join('?' * 16)})",
            (
                agent,
                number,
                json.dumps(dict(profile), allow_nan=False),
                cause.cause,
                int(cause.kind),
                cause.source,
                cause.reason,
                cause.feedback_id,
                cause.epoch,
                cause.round,
                cause.rate,
                json.dumps(dict(cause.target), allow_nan=False),
                cause.scene_id,
                cause.cancels,
                cause.restores,
                row.stamp,
            ),
        )
        return row

    def _select(self, where: str, *values: str | int) -> list[Revision]:
        try:
            rows = self._database.execute(f"SELECT {_COLUMNS} FROM revision {where}", values)
            return [_revision(row) for row in rows]
        except sqlite3.OperationalError as error:
            raise unreadable(self.path, error) from error
        except (sqlite3.DatabaseError, ValueError, AttributeError) as error:
            raise corrupt(self.path, str(error)) from error

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._database.execute("COMMIT")
            except BaseException:
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
                raise
        except (sqlite3.Error, ValueError) as error:
            raise LedgerError(
                "LEDGER_FAILED",
                f"{self.path}: {error}; nothing was recorded, look at the disk's space and rights",
            ) from error

    def _unlock(self) -> None:
        if self._lock is not None:
            self._lock.close()


def _revision(row: tuple[object, ...]) -> Revision:
    """Return one row as read; raises ``ValueError`` or ``AttributeError`` for a damaged one."""
    agent, number, profile, cause, kind, source, reason, feedback_id, epoch, round_, rate = row[
        :11
    ]
    target, scene_id, cancels, restores, stamp = row[11:]
    return Revision(
        agent=str(agent),
        revision=int(str(number)),
        profile=_values(profile),
        cause=Cause(
            cause=str(cause),
            kind=int(str(kind)),
            source=str(source),
            reason=str(reason),
            feedback_id=None if feedback_id is None else str(feedback_id),
            epoch=str(epoch),
            round=int(str(round_)),
            rate=float(str(rate)),
            target=_values(target),
            scene_id=str(scene_id),
            cancels=bool(cancels),
            restores=None if restores is None else int(str(restores)),
        ),
        stamp=float(str(stamp)),
    )


def _values(text: object) -> dict[str, float]:
    values = {str(name): float(value) for name, value in json.loads(str(text)).items()}
    if not all(map(math.isfinite, values.values())):
        raise ValueError(f"a profile holds a value that is not finite: {text}")
    return values
