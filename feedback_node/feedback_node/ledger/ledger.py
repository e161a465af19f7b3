# SPDX-License-Identifier: Apache-2.0
"""The ledger: every revision of every profile with its cause, on disk before it counts."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

from bt_agents_core.errors import STORAGE_FULL, Refused
from bt_agents_core.feedback import FeedbackKind
from feedback_node.ledger.commit_marker import Head
from feedback_node.ledger.erasure import Scrubber, redact
from feedback_node.ledger.ledger_file import (
    FAILED,
    MEMORY,
    LedgerError,
    failed,
    is_full,
    lock_file,
    open_database,
)
from feedback_node.ledger.ledger_reading import LedgerReader
from feedback_node.ledger.ledger_rows import (
    AUTHORED,
    FORGOTTEN,
    FORGOTTEN_LAYER,
    INSERT,
    RESET,
    STARTS,
    UNDO,
    ProfileRevision,
    RevisionCause,
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

    A lock file beside the database keeps a second writer out; readers are welcome at any time.
    """

    def __init__(self, path: str | Path, *, wall: Callable[[], float] = time.time) -> None:
        """Open a ledger and check all of it; a missing file and its folder are created.

        Args:
            path: SQLite file, or ``":memory:"``.
            wall: Wall time of the entries [s].

        Raises:
            LedgerError: ``LEDGER_IN_USE``, or as in :func:`open_database`.
        """
        self._wall = wall
        self._lock: TextIO | None = None
        self._numbers: dict[tuple[str, str], int] = {}
        if str(path) != MEMORY:
            # What belongs to a ledger lies beside the file itself, whichever link leads to it.
            path = Path(path).resolve()
            self._lock = lock_file(path)
        try:
            database, self._head = open_database(str(path))
        except BaseException:
            self._unlock()
            raise
        super().__init__(database, str(path))
        try:
            last = self._database.execute(
                "SELECT number, chain FROM revision ORDER BY number DESC LIMIT 1"
            ).fetchone()
            self._end = self._pending = Head(number=last[0], chain=last[1]) if last else Head()
            # What a crash has left committed and not acknowledged counts from now on.
            self._acknowledge()
            self._scrubber = Scrubber(self._database)
        except (sqlite3.Error, ValueError, OSError) as error:
            self.close()
            raise failed(self.path, error) from error

    def tidy(self) -> bool:
        """Move what was committed from the write-ahead log into the database file.

        A close would do it otherwise, and on a slow disk outlast the time a process has to stop.
        What was forgotten goes from the file here when it could not go at once.

        Returns:
            False when it still could not.
        """
        self._scrubber.again()
        with suppress(sqlite3.OperationalError):
            self._database.execute("PRAGMA wal_checkpoint(PASSIVE)")
        return self.secure() and not self._scrubber.outstanding

    def secure(self) -> bool:
        """Have the disk hold what the head file says; return False when it did not take it."""
        try:
            if self._head is not None:
                self._head.sync()
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the file and let another writer in; closing twice is fine."""
        self._database.close()
        self.secure()
        if self._head is not None:
            self._head.close()
            self._head = None
        self._unlock()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # What is written

    def enter(self, profiles: Mapping[str, Mapping[str, float]]) -> dict[str, ProfileRevision]:
        """Record what the agents' files say and return the current revision of each.

        A new agent starts at revision 0. Where the author has edited a value since the last
        authored revision, the file's profile becomes a new one, so that the edit wins over what
        was learned before; a layer of the agent takes the edited values only. Where only
        parameters have come or gone, the learned values stay and new parameters take the
        authored value.

        Args:
            profiles: Agent → parameter → value, as the file has it.

        Raises:
            LedgerError: As in :func:`failed`, or ``LEDGER_CORRUPT``; nothing is recorded.
        """
        with self._writing():
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
            LedgerError: As in :meth:`enter`; nothing is recorded.
        """
        with self._writing():
            ids = {e.cause.feedback_id for e in entries if e.cause.feedback_id is not None}
            if any(map(self.has, ids)):
                return tuple(row for one in sorted(ids) for row in self.found(one))
            recorded = []
            for entry in entries:
                if self._newest(entry.agent, entry.layer) is None:
                    self._last(entry.agent, "")
                recorded.append(self._append(entry))
            return tuple(recorded)

    def undo(
        self, agent: str, layer: str = "", *, source: str = "", reason: str = ""
    ) -> ProfileRevision:
        """Bring back the profile before the last change, as a new revision.

        Again and again it goes further back, down to the last profile that the author wrote, or
        to that with which the layer began.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``UNKNOWN_LAYER`` or ``NOTHING_TO_UNDO``.
            LedgerError: As in :meth:`enter`; nothing is recorded.
        """
        with self._writing():
            last = self._last(agent, layer)
            undone = self._restored(last)
            if undone.cause.cause in STARTS:
                raise Refused(
                    "NOTHING_TO_UNDO",
                    f"{name_of(agent, layer)}: revision {undone.revision} is "
                    + (
                        "what its file says; edit the profile there"
                        if undone.cause.cause == AUTHORED
                        else "where the layer begins"
                    ),
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
            return self._append(
                LedgerEntry(agent=agent, layer=layer, profile=back.profile, cause=cause)
            )

    def reset(
        self, agent: str, layer: str = "", *, source: str = "", reason: str = ""
    ) -> ProfileRevision:
        """Bring back the profile that the author wrote last, as a new revision.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``UNKNOWN_LAYER``.
            LedgerError: As in :meth:`enter`; nothing is recorded.
        """
        with self._writing():
            self._last(agent, layer)
            authored = self.authored(agent)
            cause = RevisionCause(
                cause=RESET,
                kind=FeedbackKind.SET,
                source=source,
                reason=reason or "back to the profile of its file",
                target=authored,
            )
            return self._append(
                LedgerEntry(agent=agent, layer=layer, profile=authored, cause=cause)
            )

    def forget(self, profiles: Iterable[tuple[str, str]], *, source: str = "") -> str:
        """Take the content of layers out of the file; a row for each says that it was there.

        Hashes stay, so that the chain can be followed, and so that feedback which comes once more
        is not applied once more.

        Args:
            profiles: Agent and layer of each.
            source: Who asks.

        Returns:
            What keeps traces of them in the file for now, in words; empty when they are gone.

        Raises:
            Refused: ``UNKNOWN_LAYER``, also for everybody's profile.
            LedgerError: As in :meth:`enter`; nothing is forgotten.
        """
        with self._writing():
            self._numbers.clear()
            for agent, layer in profiles:
                last = self.current(agent, layer) if layer else None
                if last is None:
                    raise Refused(
                        "UNKNOWN_LAYER",
                        f"{agent} has no layer '{layer}', so there is nothing to forget",
                    )
                stays = f"{FORGOTTEN_LAYER}{self._pending.number + 1}"
                seal = redact(self._database, agent, layer, stays)
                self._append(
                    LedgerEntry(
                        agent=agent,
                        layer=stays,
                        profile={},
                        cause=RevisionCause(cause=FORGOTTEN, source=source, seal=seal),
                    ),
                    revision=last.revision + 1,
                )
        self._scrubber.due()
        return self._scrubber.scrub()

    def _enter(self, agent: str, authored: Mapping[str, float]) -> ProfileRevision:
        last = self.current(agent)
        cause = RevisionCause(cause=AUTHORED, source="file", reason="first seen", target=authored)
        if last is None:
            return self._append(LedgerEntry(agent=agent, profile=authored, cause=cause))
        written = self.authored(agent)
        edited = [name for name in authored if name in written and authored[name] != written[name]]
        if not edited and authored.keys() == written.keys():
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
            self._append(LedgerEntry(agent=agent, layer=row.layer, profile=profile, cause=cause))
        kept = {} if edited else last.profile
        profile = {name: kept.get(name, value) for name, value in authored.items()}
        return self._append(LedgerEntry(agent=agent, profile=profile, cause=cause))

    def _newest(self, agent: str, layer: str) -> int | None:
        """Return the number of the latest revision of an agent; None for an unknown one."""
        if (agent, layer) not in self._numbers:
            last = self.current(agent, layer)
            if last is None:
                return None
            self._numbers[agent, layer] = last.revision
        return self._numbers[agent, layer]

    def _append(self, entry: LedgerEntry, revision: int | None = None) -> ProfileRevision:
        if revision is None:
            newest = self._newest(entry.agent, entry.layer)
            revision = 0 if newest is None else newest + 1
        appended = ProfileRevision(
            agent=entry.agent,
            layer=entry.layer,
            revision=revision,
            profile=dict(entry.profile),
            cause=entry.cause,
            stamp=self._wall(),
        )
        row = row_of(self._pending.number + 1, appended, self._pending.chain)
        self._database.execute(INSERT, row)
        self._pending = Head(number=row.number, chain=row.chain)
        self._numbers[entry.agent, entry.layer] = revision
        if entry.cause.cause == AUTHORED and not entry.layer:
            self._written[entry.agent] = appended.cause.target
        return appended

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            # One that could not be written the last time: without it, a loss of what it marks
            # would not be noticed.
            self._acknowledge()
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._database.execute("COMMIT")
            except BaseException:
                self._pending = self._end
                self._written.clear()
                self._numbers.clear()
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
                raise
            self._end = self._pending
        except (sqlite3.Error, ValueError, OSError) as error:
            raise failed(self.path, error) from error
        try:
            self._acknowledge()
        except OSError as error:
            raise LedgerError(
                STORAGE_FULL if is_full(error) else FAILED,
                f"{self.path}: it is recorded, but not acknowledged, as the -head file cannot be "
                f"written ({error}); give the same once more, under the same id",
            ) from error

    def _acknowledge(self) -> None:
        if self._head is not None and self._head.head != self._end:
            self._head.write(self._end)

    def _unlock(self) -> None:
        if self._lock is not None:
            self._lock.close()
