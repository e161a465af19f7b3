# SPDX-License-Identifier: Apache-2.0
"""The ledger: every revision of every profile with its cause, on the disk before it counts."""

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
    """A revision to be recorded."""

    agent: str
    layer: str = ""
    profile: Mapping[str, float]
    cause: RevisionCause


class Ledger(LedgerReader):
    """The only writer of one SQLite file; a change is on the disk when its method returns.

    A lock file beside the database keeps a second writer out, and tells when the end of the
    database is lost; readers are welcome at any time.
    Changes raise :class:`LedgerError` as :func:`failed` says, or with ``LEDGER_CORRUPT``; whatever
    is raised, nothing of them is recorded.

    Attributes:
        failure: Why the last change was not recorded; empty when it was.
    """

    def __init__(self, path: str | Path, *, wall: Callable[[], float] = time.time) -> None:
        """Open a ledger and check all of it; a missing file and its folder are created.

        Raises:
            LedgerError: ``LEDGER_IN_USE``, or as in :func:`open_database`.
        """
        self.failure = ""
        self._wall = wall
        self._revisions: dict[tuple[str, str], int] = {}
        self._lock: LedgerLock | None = None
        with ExitStack() as opened:
            if str(path) != MEMORY:
                # What belongs to a ledger lies beside the file itself, whichever link leads to it.
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
        """Move what was committed from the write-ahead log into the database file.

        A close would do it otherwise, and on a slow disk outlast the time a process has to stop.
        Traces of what was forgotten go from the file here when they could not go at once; returns
        False when they still could not.
        """
        self._erasure.retry()
        with suppress(sqlite3.OperationalError):
            self._database.execute("PRAGMA wal_checkpoint(PASSIVE)")
        return not self._erasure.pending

    def close(self) -> None:
        """Close the file and let another writer in; closing twice is fine."""
        self._opened.close()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Changes

    def enter(self, profiles: Mapping[str, Mapping[str, float]]) -> dict[str, ProfileRevision]:
        """Record authored profiles and return the current revision of each agent.

        A new agent starts at revision 0. Where the author has edited a value since the last
        authored revision, the file's profile becomes a new one, so that the edit wins over what
        was learned before; a layer of the agent takes the edited values only. Where only
        parameters have come or gone, the learned values stay and new parameters take the
        authored value.
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
        """Record revisions together; a known ``feedback_id`` returns its old ones instead.

        Raises:
            Refused: ``UNKNOWN_AGENT`` for an agent that was never entered.
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
        """Bring back the profile before the last change, as a new revision.

        Again and again it goes further back, down to the last profile that the author wrote, or
        to that with which the layer began.

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
                    "NOTHING_TO_UNDO",
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
        """Bring back the profile that the author wrote last, as a new revision.

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
        """Erase the content of layers from the file; a row for each says that it was there.

        Hashes of the feedback ids and of the layer's name stay, so that late repetitions are not
        applied again, and the other robots of a fleet forget it, too.

        Returns:
            Why traces of them stay in the file for now; empty when they are gone.

        Raises:
            Refused: ``UNKNOWN_LAYER``, also for everybody's profile.
        """
        with self._transaction():
            self._revisions.clear()
            for agent, layer in profiles:
                last = self.current(agent, layer) if layer else None
                if last is None:
                    raise Refused(
                        "UNKNOWN_LAYER",
                        f"{agent} has no layer '{layer}', so there is nothing to forget",
                    )
                step = {"layer": hidden_layer(layer), "stamp": self._end_of(agent, layer)}
                cause = RevisionCause(cause=FORGOTTEN, source=source, step=step)
                self._erase(agent, layer, last, cause)
        return self._erasure.start()

    def forget_as_told(
        self, agent: str, layer: str, cause: RevisionCause, kept: Iterable[LedgerEntry] = ()
    ) -> tuple[tuple[ProfileRevision, ...], str]:
        """Erase a layer that another robot has forgotten, and record anew what came later.

        Args:
            agent: Whose layer.
            layer: Its name; empty where it is not there, so that only the forgetting is recorded.
            cause: With the step of the other robot.
            kept: What is recorded anew.

        Returns:
            The revisions of ``kept``, and as :meth:`forget`.
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
        """Erase a layer, and record why; only that where there is none."""
        if last is None:
            stays, revision = f"{FORGOTTEN_LAYER}{self._next_number()}", 0
        else:
            stays, revision = erase_layer(self._database, agent, layer), last.revision + 1
        self._append(agent, stays, {}, cause, revision=revision)

    def _end_of(self, agent: str, layer: str) -> float:
        """Return the wall time behind everything in a layer, also what other clocks have said."""
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
