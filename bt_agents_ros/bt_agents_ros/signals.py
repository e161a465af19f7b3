# SPDX-License-Identifier: Apache-2.0
"""SIGINT and SIGTERM: silent while a program is being loaded, later a flag that loops poll."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

STOPPING = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """Raised by SIGINT or SIGTERM within :meth:`Interrupt.raising`."""


class Interrupt:
    """Flag that SIGINT or SIGTERM sets."""

    def __init__(self) -> None:
        self._requested = False
        self._raises = False
        self._before = {number: signal.signal(number, self._handle) for number in STOPPING}

    def _handle(self, _signal: int, _frame: FrameType | None) -> None:
        self._requested = True
        if self._raises:
            self._raises = False
            raise Interrupted

    def __bool__(self) -> bool:
        return self._requested

    def release(self) -> None:
        """Give the signals back to those who had them before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @contextmanager
    def raising(self) -> Iterator[None]:
        """Have a signal raise an exception within this block, which may take long.

        Raises:
            Interrupted: A signal has come, perhaps before the block.
        """
        self._raises = True
        try:
            if self._requested:
                raise Interrupted
            yield
        finally:
            self._raises = False


def end_silently() -> None:
    """Let a Ctrl-C end the process without a traceback, as SIGTERM does.

    The parent may block SIGINT until here with :func:`block_sigint`, as Python itself prints a
    traceback when it comes before the first line of a program.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def loading() -> Iterator[None]:
    """Let a Ctrl-C end the process without output while modules are imported in this block.

    A ``KeyboardInterrupt`` would come out of a library of ROS as an error of that library.
    """
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def block_sigint() -> set[int | signal.Signals]:
    """Block SIGINT for the process that is started next; return the mask to restore after that."""
    return set(signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}))
