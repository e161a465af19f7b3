# SPDX-License-Identifier: Apache-2.0
"""Feed of one client: the next message for it, however slowly it reads."""

from __future__ import annotations

from collections.abc import Collection

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_studio.history import History
from bt_agents_studio.protocol import (
    VERSION,
    ClientMessage,
    Delta,
    Present,
    Resume,
    Seek,
    ServerMessage,
    Snapshot,
    encode,
)
from bt_agents_studio.recordings import moment_of
from bt_agents_studio.records import OF_THE_PRESENT, BookmarkRecord
from bt_agents_studio.store import Entries, NewValue, Store


class Feed:
    """Messages of a store that one client has received, of now or of an earlier moment.

    A client at an earlier moment also receives the current run, so that it can stop it.

    Nothing is queued for a client. It receives the changes since its last message, only the newest
    value of each entry, so a slow client gets fewer and larger messages.

    Args:
        store: Store of the running system.
        history: History of the store.
        studio: Identifier of this start of the studio.
        collections: Collections that the client may see, only as of now; None for all.
    """

    def __init__(
        self,
        store: Store,
        history: History,
        studio: str,
        collections: Collection[str] | None = None,
    ) -> None:
        self._collections = collections
        self._store = store
        self._history = history
        self._studio = studio
        self._sent: int | None = None
        self._seek: Seek | None = None
        self._is_moment_due = False
        self._resumed = False
        # Moment of a recording that is being read, and the last result.
        self._reading: Seek | None = None
        self._read: str | None = None

    def take(self, message: ClientMessage) -> None:
        """Handle a message of the client; :meth:`next` returns the answer.

        Raises:
            Refused: ``OTHER_VERSION``, ``NOT_RESUMED`` or ``FORBIDDEN``.
        """
        if isinstance(message, Resume):
            if message.version != VERSION:
                raise Refused(
                    RefusalCode.OTHER_VERSION,
                    f"the page speaks version {message.version} of the protocol, the studio "
                    f"{VERSION}; load the page anew",
                )
            self._resumed = True
            self._seek, self._is_moment_due, self._read = None, False, None
            known = message.studio == self._studio and message.sequence <= self._store.sequence
            self._sent = message.sequence if known and message.sequence else None
        elif not self._resumed:
            raise Refused(RefusalCode.NOT_RESUMED, f"'{message.type}' comes after 'resume'")
        elif isinstance(message, Seek):
            if self._collections is not None:
                raise Refused(
                    RefusalCode.FORBIDDEN, "this session is shown what happens now, nothing else"
                )
            self._seek, self._is_moment_due, self._read = message, True, None
        else:
            self._return()

    def take_recorded(self) -> Seek | None:
        """Return the next moment of a recording to read, for :meth:`give`; None while reading one.

        Of all moments that the client has requested meanwhile, only the last one counts.
        """
        seek = self._seek
        if self._reading is not None or seek is None or not seek.source or not self._is_moment_due:
            return None
        self._reading, self._is_moment_due = seek, False
        return seek

    def give(self, encoded: str, *, is_failure: bool = False, is_whole: bool = True) -> None:
        """Take a moment read from a recording, unless the client has requested another view.

        After a failure, the client returns to now. Until all of a recording has been read, its
        moment stays due.
        """
        read, self._reading = self._reading, None
        wanted = self._seek
        if read is None or wanted is None or wanted.source != read.source:
            return
        if not is_failure:
            # The client may have requested another moment; this one at least shows progress.
            self._read = encoded
            if not is_whole:
                self._is_moment_due = True
        elif wanted is read:
            self._return()
            self._read = encoded

    def next(self) -> ServerMessage | str | None:
        """Return the next message, which may be encoded; None if there is nothing new."""
        if not self._resumed:
            return None
        if self._read is not None:
            read, self._read = self._read, None
            return read
        if self._seek is not None and self._is_moment_due and not self._seek.source:
            self._is_moment_due = False
            return encode(moment_of(self._store, self._history, self._seek.at_s))
        if self._sent == self._store.sequence:
            return None
        changes = self._store.since(self._sent) if self._sent is not None else None
        self._sent = self._store.sequence
        if self._seek is not None:
            return self._present(changes)
        if changes is not None:
            shown = tuple(one for one in changes if self._shows(one[0]))
            return Delta(sequence=self._sent, changes=shown) if shown else None
        return Snapshot(
            sequence=self._sent,
            at_s=None,
            source="",
            first_s=self._history.first_s,
            last_s=self._history.last_s,
            bookmarks=self._store.values("bookmarks", BookmarkRecord)
            if self._shows("bookmarks")
            else (),
            is_whole=True,
            entries=shown_entries(self._store.snapshot(), self._collections),
        )

    def _shows(self, collection: str) -> bool:
        return self._collections is None or collection in self._collections

    def _return(self) -> None:
        self._seek, self._is_moment_due, self._read = None, False, None
        self._sent = None

    def _present(self, changes: list[NewValue] | None) -> ServerMessage | None:
        is_whole = changes is None
        if changes is None:
            changes = [
                (name, key, value)
                for name, entries in self._store.snapshot().items()
                for key, value in entries.items()
            ]
        shown = tuple(one for one in changes if one[0] in OF_THE_PRESENT)
        return Present(changes=shown, is_whole=is_whole) if shown or is_whole else None


def shown_entries(entries: Entries, collections: Collection[str] | None) -> Entries:
    """Return the entries of some collections; None stands for all."""
    if collections is None:
        return entries
    return {name: found for name, found in entries.items() if name in collections}
