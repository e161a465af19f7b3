# SPDX-License-Identifier: Apache-2.0
"""SIGINT and SIGTERM: silent while a program loads, later a flag that loops poll."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Thread, Timer
from types import FrameType
from typing import ClassVar, NoReturn

from bt_agents_core.gc_pause import gc_paused

STOPPING = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """Raised by :func:`check_interrupt` when SIGINT or SIGTERM has come."""


class Interrupt:
    """Flag that SIGINT or SIGTERM sets.

    The signal handler raises nothing: it may run within ``Condition.__enter__`` or the import of a
    module, whose lock would then be held for ever, or in a finalizer, where the exception would be
    lost.
    """

    newest: ClassVar[Interrupt | None] = None

    def __init__(self) -> None:
        Interrupt.newest = self
        self._requested = False
        self._ends_at_second = False
        self._before = {number: signal.signal(number, self._handle) for number in STOPPING}

    def _handle(self, _signal: int, _frame: FrameType | None) -> None:
        self._requested = True
        if self._ends_at_second:
            for number in STOPPING:
                signal.signal(number, signal.SIG_DFL)

    def __bool__(self) -> bool:
        return self._requested

    def release(self) -> None:
        """Restore the previous signal handlers."""
        Interrupt.newest = None
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @contextmanager
    def waking(self, wake: Callable[[], None]) -> Iterator[None]:
        """Call ``wake`` in its own thread when a signal arrives within this block.

        A wait within a C library continues when a signal arrives; the flag is set only after it.
        """
        receiving, sending = socket.socketpair()
        sending.setblocking(False)

        def wait() -> None:
            while receiving.recv(1):
                wake()

        thread = Thread(target=wait, name="signals", daemon=True)
        thread.start()
        before = signal.set_wakeup_fd(sending.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)
            sending.close()
            thread.join()
            receiving.close()

    @contextmanager
    def ending_at_second(self) -> Iterator[None]:
        """Let a second signal end the process at once within this block, which may take long."""
        self._ends_at_second = True
        try:
            yield
        finally:
            self._ends_at_second = False
            for number in STOPPING:
                signal.signal(number, self._handle)


def check_interrupt() -> None:
    """Abort a start at a safe point; no effect without an :class:`Interrupt`.

    Raises:
        Interrupted: SIGINT or SIGTERM has arrived.
    """
    if Interrupt.newest:
        raise Interrupted


def end_silently() -> None:
    """Let a Ctrl-C end the process without a traceback, as SIGTERM does.

    The parent may block SIGINT until here with :func:`sigint_blocked`, because Python itself
    prints a traceback if the signal arrives before the first line of a program.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


_AGAIN_S = 0.01
"""Time from the loss of a Ctrl-C until it is raised again [s]."""


class _LastingInterrupt(KeyboardInterrupt):
    """A ``KeyboardInterrupt`` that is raised again when it is lost.

    C code clears exceptions of the Python code that it calls: numpy in some comparisons, Cython
    in some imports. That frees the exception, and the program would continue.
    """

    def __del__(self) -> None:
        if signal.getsignal(signal.SIGINT) is _raise:
            # An exception raised here would be lost, too.
            Timer(_AGAIN_S, _raise_again).start()


def _raise_again() -> None:
    if signal.getsignal(signal.SIGINT) is _raise:
        os.kill(os.getpid(), signal.SIGINT)


def _raise(_signal: int, _frame: FrameType | None) -> NoReturn:
    raise _LastingInterrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """Let a Ctrl-C raise ``KeyboardInterrupt`` within this block, and end the process after it.

    Code in the block that catches it and continues must call :func:`end_silently`.
    """
    signal.signal(signal.SIGINT, _raise)
    try:
        yield
    finally:
        end_silently()


@contextmanager
def loading() -> Iterator[None]:
    """Let a Ctrl-C end the process without output while modules are imported in this block.

    A ROS library would turn a ``KeyboardInterrupt`` into an error of its own. The garbage
    collector pauses, because modules stay.
    """
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        with gc_paused():
            yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def sigint_blocked() -> Iterator[None]:
    """Block SIGINT within this block; a process that starts in it inherits that."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
