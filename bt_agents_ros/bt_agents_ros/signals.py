# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM: silent while a program is being loaded, later a flag that loops look at."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

STOPPING = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """The program is to end in the middle of what may be cut short."""


class Interrupt:
    """Becomes true when the user or the system wants the program to end."""

    def __init__(self) -> None:
        self._asked = False
        self._cuts_short = False
        for number in STOPPING:
            signal.signal(number, self._ask)

    def _ask(self, _signal: int, _frame: FrameType | None) -> None:
        self._asked = True
        if self._cuts_short:
            self._cuts_short = False
            raise Interrupted

    def __bool__(self) -> bool:
        return self._asked

    @contextmanager
    def cutting_short(self) -> Iterator[None]:
        """Raise what is asked for as an exception within this block, which may take long.

        Raises:
            Interrupted: The program is to end.
        """
        self._cuts_short = True
        try:
            if self._asked:
                raise Interrupted
            yield
        finally:
            self._cuts_short = False


def end_silently() -> None:
    """Let a Ctrl-C end the process without a traceback, as SIGTERM does.

    Whoever starts a process may hold SIGINT back until here with ``hold_back``, as Python itself
    prints a traceback when it comes before the first line of a program.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def loading() -> Iterator[None]:
    """Let a Ctrl-C end the process without a word while modules are imported in this block.

    A ``KeyboardInterrupt`` would come out of a library of ROS as an error of that library.
    """
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def hold_back() -> set[int | signal.Signals]:
    """Hold SIGINT back for the process that is started next; return what to restore after that."""
    return set(signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}))
