# SPDX-License-Identifier: Apache-2.0
"""Control of a recording: its start, its end, its label and its bookmarks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize
from bt_agents_lab.recorder.daily_recorder import DailyRecorder

MOST_BOOKMARKS = 10_000
"""Maximum number of bookmarks in one recording."""


@dataclass(frozen=True, kw_only=True)
class RecordingState:
    """State of the recording: whether it records, and its details.

    Attributes:
        since_ns: When this state began [ns since 1970].
        file: Current file, else the last one.
        author: Who started it; empty if it began with the journal.
        bookmarks: Number of its bookmarks.
    """

    since_ns: int
    is_recording: bool
    file: str
    label: str = ""
    notes: str = ""
    author: str = ""
    bookmarks: int = 0


@dataclass(frozen=True, kw_only=True)
class MarkedMoment:
    """Bookmarked moment of a recording [ns since 1970]."""

    at_ns: int
    label: str
    notes: str
    author: str


class RecordingListener(Protocol):
    """Listener that publishes changes, and records those that belong in the recording."""

    def on_state(self, state: RecordingState) -> None:
        """Take the new state."""

    def on_bookmark(self, moment: MarkedMoment) -> None:
        """Take a bookmarked moment."""


class RecordingControl:
    """Start, end and bookmarks of the recordings of one recorder, which is already recording.

    Args:
        recorder: Writes the files.
        listener: Gets every change, and the initial state.
        now_ns: Returns the time of day [ns since 1970].
        clock: Returns the steady time [s].
    """

    def __init__(
        self,
        recorder: DailyRecorder,
        listener: RecordingListener,
        now_ns: Callable[[], int],
        clock: Callable[[], float],
    ) -> None:
        self._recorder = recorder
        self._listener = listener
        self._now_ns = now_ns
        self._clock = clock
        self._begun_at = clock()
        self.state = RecordingState(since_ns=now_ns(), is_recording=True, file=recorder.path.name)
        listener.on_state(self.state)

    def start(self, *, label: str, notes: str, author: str) -> str:
        """Begin a new file; return a message about it.

        Raises:
            Refused: ``RECORDING_ALREADY``, ``IN_USE`` or ``CANNOT_WRITE``.
        """
        if self.state.is_recording:
            raise Refused(
                RefusalCode.RECORDING_ALREADY,
                f"{self._named()} is being recorded; stop it before another one begins",
            )
        now_ns = self._now_ns()
        try:
            self._recorder.start(now_ns)
        except OSError as error:
            raise Refused(
                RefusalCode.CANNOT_WRITE,
                f"no recording can be begun ({error.strerror or error}); make room, or look at "
                "the rights of the folder",
            ) from None
        self._begun_at = self._clock()
        self._set(
            RecordingState(
                since_ns=now_ns,
                is_recording=True,
                file=self._recorder.path.name,
                label=label,
                notes=notes,
                author=author,
            )
        )
        return f"{self._named()} is being recorded"

    def stop(self) -> str:
        """End the file; return a message about it.

        Raises:
            Refused: ``NOT_RECORDING``.
        """
        self._check_recording()
        self._recorder.stop()
        self._set(replace(self.state, since_ns=self._now_ns(), is_recording=False))
        return f"{self._named()} has ended, nothing is recorded now"

    def mark(self, *, label: str, notes: str, author: str, age_s: float = 0.0) -> str:
        """Mark a moment of the recording; return a message about it.

        Args:
            label: In a few words; may be empty.
            notes: In more words; may be empty.
            author: Who marks it; may be empty.
            age_s: How long ago the moment was [s].

        Raises:
            Refused: ``NOT_RECORDING``, ``OUT_OF_RANGE`` or ``TOO_MANY`` bookmarks.
        """
        self._check_recording()
        begun_s = self._clock() - self._begun_at
        if not 0.0 <= age_s <= begun_s:
            raise Refused(
                RefusalCode.OUT_OF_RANGE,
                f"the moment was {age_s:g} s ago, expected 0 to {begun_s:.1f}: {self._named()} "
                "has no other moments",
            )
        if self.state.bookmarks >= MOST_BOOKMARKS:
            raise Refused(
                RefusalCode.TOO_MANY,
                f"{self._named()} has {MOST_BOOKMARKS} bookmarks, no more may be; begin another "
                "recording",
            )
        self._listener.on_bookmark(
            MarkedMoment(
                at_ns=self._now_ns() - round(age_s * 1e9), label=label, notes=notes, author=author
            )
        )
        self._set(replace(self.state, bookmarks=self.state.bookmarks + 1))
        return f"marked in {self._named()}" + (f": {ellipsize(label, 80)}" if label else "")

    def check_file(self) -> None:
        """Report a new file that a new day has begun."""
        if self.state.is_recording and self.state.file != self._recorder.path.name:
            self._set(replace(self.state, file=self._recorder.path.name))

    def _check_recording(self) -> None:
        if not self.state.is_recording:
            raise Refused(
                RefusalCode.NOT_RECORDING,
                "nothing is recorded now; 'bt-agents record start' begins a recording",
            )

    def _set(self, state: RecordingState) -> None:
        self.state = state
        self._listener.on_state(state)

    def _named(self) -> str:
        label = f" '{ellipsize(self.state.label, 80)}'" if self.state.label else ""
        return f"{self.state.file}{label}"
