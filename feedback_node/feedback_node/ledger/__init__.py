# SPDX-License-Identifier: Apache-2.0
"""The ledger: every revision of every profile with its cause, on disk before it counts."""

from __future__ import annotations

import math
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.refusal_codes import RefusalCode
from feedback_node.ledger.erasure import FileErasure, erase_layer
from feedback_node.ledger.file import (
    MEMORY,
    LedgerLock,
    failed,
    has_content,
    open_database,
    unread,
)
from feedback_node.ledger.reading import LedgerReader
from feedback_node.ledger.rows import (
    AUTHORED,
    FORGOTTEN,
    FORGOTTEN_LAYER,
    INSERT,
    LAYER,
    RESET,
    UNDO,
    ProfileRevision,
    RevisionCause,
    hidden_layer,
    name_of,
    row_of,
)


@dataclass(frozen=True, kw_only=True)
class LedgerEntry:
    """A revision to record."""

    agent: str
    layer: str = ""
    profile: Mapping[str, float]
    cause: RevisionCause


class Ledger(LedgerReader):
    """The only writer of an SQLite file; a change is on disk when its method returns.

    A lock file next to the database excludes a second writer and shows if the end of the database
    is lost; readers are allowed at any time.
    Changes raise :class:`LedgerError` as described in :func:`failed`, or with ``LEDGER_CORRUPT``;
    a change that raises an error records nothing.

    Attributes:
        failure: Why the last change was not recorded; empty if it was.
    """

    def __init__(self, path: str | Path, *, wall: Callable[[], float] = time.time) -> None:
        """Open a ledger and check all of it; create a missing file with its folder.

        Raises:
            LedgerError: ``LEDGER_IN_USE``, or as in :func:`open_database`.
        """
        self.failure = ""
        self._wall = wall
        self._revisions: dict[tuple[str, str], int] = {}
        self._lock: LedgerLock | None = None
        with ExitStack() as opened:
            if str(path) != MEMORY:
                # The other files of a ledger are next to the file itself, not to a link to it.
                path = Path(path).resolve()
                self._lock = opened.enter_context(closing(LedgerLock(path)))
                if not has_content(str(path)):
                    self._lock.record(0)
            database = opened.enter_context(closing(open_database(str(path))))
            super().__init__(database, str(path))
            try:
                self._erasure = FileErasure(database)
            except sqlite3.Error as error:
                raise unread(self.path, error) from error
            self._opened = opened.pop_all()

    def checkpoint(self) -> bool:
        """Move committed changes from the write-ahead log into the database file.

        Otherwise a close would do this, which on a slow disk may exceed the time for the stop of a
        process. It also removes traces of forgotten content that could not be removed at once;
        returns False if they still cannot be removed.
        """
        self._erasure.retry()
        with suppress(sqlite3.OperationalError):
            self._database.execute("PRAGMA wal_checkpoint(PASSIVE)")
        return not self._erasure.pending

    def close(self) -> None:
        """Close the file and admit another writer; may be called twice."""
        self._opened.close()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Changes

    def enter(self, profiles: Mapping[str, Mapping[str, float]]) -> dict[str, ProfileRevision]:
        """Record authored profiles and return the current revision of each agent.

        A new agent starts at revision 0. If the author has edited a value since the last authored
        revision, the profile in the file becomes a new revision, so the edit overrides what was
        learned; layers of the agent get only the edited values. If parameters were only added or
        removed, the learned values stay and new parameters get the authored values.
        """
        with self._transaction():
            return {agent: self._enter(agent, profile) for agent, profile in profiles.items()}

    def append(
        self, agent: str, profile: Mapping[str, float], cause: RevisionCause, *, layer: str = ""
    ) -> ProfileRevision:
        """Record a new profile of an agent; see :meth:`record`."""
        entry = LedgerEntry(agent=agent, layer=layer, profile=profile, cause=cause)
        return self.record([entry])[0]

    def record(self, entries: Sequence[LedgerEntry]) -> tuple[ProfileRevision, ...]:
        """Record revisions together; for a known ``feedback_id``, return its old ones instead.

        Raises:
            Refused: ``UNKNOWN_AGENT``; the agent was never entered.
        """
        with self._transaction():
            ids = {e.cause.feedback_id for e in entries if e.cause.feedback_id is not None}
            known = tuple(row for one in sorted(ids) for row in self.find_all(one))
            if known:
                return known
            recorded = []
            for entry in entries:
                if self._newest(entry.agent, entry.layer) is None:
                    self._last(entry.agent, "")
                recorded.append(self._append(entry.agent, entry.layer, entry.profile, entry.cause))
            return tuple(recorded)

    def undo(
        self, agent: str, layer: str = "", *, source: str = "", reason: str = ""
    ) -> ProfileRevision:
        """Restore the profile before the last change, as a new revision.

        Repeated calls go further back, to the last profile that the author wrote or to the
        beginning of the layer.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``UNKNOWN_LAYER`` or ``NOTHING_TO_UNDO``.
        """
        with self._transaction():
            last = self._last(agent, layer)
            undone = self._restored(last)
            if undone.cause.cause in (AUTHORED, LAYER):
                start = "where the layer begins"
                if undone.cause.cause == AUTHORED:
                    start = "what its file says; edit the profile there"
                raise Refused(
                    RefusalCode.NOTHING_TO_UNDO,
                    f"{name_of(agent, layer)}: revision {undone.revision} is {start}",
                )
            back = self._restored(self._row(agent, layer, undone.revision - 1))
            cause = RevisionCause(
                cause=UNDO,
                kind=FeedbackKind.SET,
                source=source,
                reason=reason or f"undoes revision {undone.revision}",
                target=back.profile,
                restores=back.revision,
                changes=back.cause.changes,
            )
            return self._append(agent, layer, back.profile, cause)

    def reset(
        self, agent: str, layer: str = "", *, source: str = "", reason: str = ""
    ) -> ProfileRevision:
        """Restore the last profile that the author wrote, as a new revision.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``UNKNOWN_LAYER``.
        """
        with self._transaction():
            self._last(agent, layer)
            authored = self.authored(agent)
            cause = RevisionCause(
                cause=RESET,
                kind=FeedbackKind.SET,
                source=source,
                reason=reason or "back to the profile of its file",
                target=authored,
            )
            return self._append(agent, layer, authored, cause)

    def forget(self, profiles: Iterable[tuple[str, str]], *, source: str = "") -> str:
        """Erase the content of layers from the file; one row per layer records that it existed.

        Hashes of the feedback ids and of the layer's name stay, so that late repetitions are not
        applied again and the other robots of a fleet can forget the layer, too.

        Returns:
            Why traces stay in the file for now; empty if they are gone.

        Raises:
            Refused: ``UNKNOWN_LAYER``, also for the profile for everybody.
        """
        with self._transaction():
            self._revisions.clear()
            for agent, layer in profiles:
                last = self.current(agent, layer) if layer else None
                if last is None:
                    raise Refused(
                        RefusalCode.UNKNOWN_LAYER,
                        f"{agent} has no layer '{layer}', so there is nothing to forget",
                    )
                step = {"layer": hidden_layer(layer), "stamp": self._end_of(agent, layer)}
                cause = RevisionCause(cause=FORGOTTEN, source=source, step=step)
                self._erase(agent, layer, last, cause)
        return self._erasure.start()

    def forget_as_told(
        self, agent: str, layer: str, cause: RevisionCause, kept: Iterable[LedgerEntry] = ()
    ) -> tuple[tuple[ProfileRevision, ...], str]:
        """Erase a layer that another robot has forgotten, and record again what came later.

        Args:
            agent: Agent of the layer.
            layer: Its name; empty if it does not exist, to record only that it was forgotten.
            cause: Cause with the step of the other robot.
            kept: Entries to record again.

        Returns:
            The revisions of ``kept``, and the result of :meth:`forget`.
        """
        with self._transaction():
            self._revisions.clear()
            last = self.current(agent, layer) if layer else None
            self._erase(agent, layer, last, cause)
            recorded = tuple(
                self._append(one.agent, one.layer, one.profile, one.cause) for one in kept
            )
        return recorded, self._erasure.start() if last is not None else ""

    def _erase(
        self, agent: str, layer: str, last: ProfileRevision | None, cause: RevisionCause
    ) -> None:
        """Erase a layer, if there is one, and record why."""
        if last is None:
            stays, revision = f"{FORGOTTEN_LAYER}{self._next_number()}", 0
        else:
            stays, revision = erase_layer(self._database, agent, layer), last.revision + 1
        self._append(agent, stays, {}, cause, revision=revision)

    def _end_of(self, agent: str, layer: str) -> float:
        """Return a wall time after everything in a layer, including times of other clocks."""
        found = self.history(agent, layer)
        stamps = [one.cause.step.get("stamp", one.stamp) for one in found]
        return max(self._wall(), math.nextafter(max(stamps), math.inf))

    def _enter(self, agent: str, authored: Mapping[str, float]) -> ProfileRevision:
        last = self.current(agent)
        cause = RevisionCause(cause=AUTHORED, source="file", reason="first seen", target=authored)
        if last is None:
            return self._append(agent, "", authored, cause)
        before = self.authored(agent)
        edited = [name for name in authored if name in before and authored[name] != before[name]]
        if not edited and authored.keys() == before.keys():
            return last
        reason = (
            f"the author changed {', '.join(edited)}"
            if edited
            else "scene parameters were added or removed"
        )
        cause = replace(cause, reason=reason)
        for row in self.layers(agent):
            learned = {k: v for k, v in row.profile.items() if k not in edited}
            profile = {name: learned.get(name, value) for name, value in authored.items()}
            self._append(agent, row.layer, profile, cause)
        own = {} if edited else last.profile
        profile = {name: own.get(name, value) for name, value in authored.items()}
        return self._append(agent, "", profile, cause)

    def _newest(self, agent: str, layer: str) -> int | None:
        """Return the number of the latest revision of an agent; None for an unknown one."""
        if (agent, layer) not in self._revisions:
            last = self.current(agent, layer)
            if last is None:
                return None
            self._revisions[agent, layer] = last.revision
        return self._revisions[agent, layer]

    def _append(
        self,
        agent: str,
        layer: str,
        profile: Mapping[str, float],
        cause: RevisionCause,
        revision: int | None = None,
    ) -> ProfileRevision:
        if revision is None:
            newest = self._newest(agent, layer)
            revision = 0 if newest is None else newest + 1
        appended = ProfileRevision(
            agent=agent,
            layer=layer,
            revision=revision,
            profile=dict(profile),
            cause=cause,
            stamp=self._wall(),
        )
        self._database.execute(INSERT, row_of(self._next_number(), appended))
        self._revisions[agent, layer] = revision
        if cause.cause == AUTHORED and not layer:
            self._authored[agent] = cause.target
        return appended

    def _next_number(self) -> int:
        last = self._database.execute("SELECT coalesce(max(number), 0) FROM revision").fetchone()
        return int(last[0]) + 1

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        try:
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield
                last = self._next_number() - 1
                self._database.execute("COMMIT")
            except BaseException:
                self._authored.clear()
                self._revisions.clear()
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
                raise
            if self._lock is not None:
                self._lock.record(last)
            self.failure = ""
        except (sqlite3.Error, ValueError) as error:
            failure = failed(self.path, error)
            self.failure = failure.reason
            raise failure from error
