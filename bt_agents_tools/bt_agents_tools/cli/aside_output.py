# SPDX-License-Identifier: Apache-2.0
"""Output written by a thread, so that the program never waits for a blocked terminal."""

from __future__ import annotations

import io
import os
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

MOST_BYTES = 1_000_000
"""Longest output that waits to be written [bytes]; further output is dropped."""

END_LIMIT_S = 1.0
"""Longest wait at the end for the rest to be written [s]."""

_ERRORS = 2
_PIPE_BYTES = 65_536


class AsideOutput(io.RawIOBase):
    """Raw stream that never blocks: a thread writes its data.

    Ctrl-S, a full pipe or a hanging connection stop only the thread. When the output is read
    again, a line reports the number of dropped lines. After an error it writes nothing more.

    Args:
        descriptor: Descriptor of the output, which stays open.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor
        self._waiting: deque[bytes] = deque()
        self._bytes = 0
        self._dropped = 0
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._write_all, name="output", daemon=True)
        self._thread.start()

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def fileno(self) -> int:
        return self._descriptor

    def write(self, data: Any, /) -> int:
        taken = bytes(data)
        with self._changed:
            if self._bytes + len(taken) > MOST_BYTES:
                self._dropped += taken.count(b"\n")
            else:
                self._waiting.append(taken)
                self._bytes += len(taken)
                self._changed.notify()
        return len(taken)

    def end(self) -> None:
        """Write the rest that can be written in time."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(END_LIMIT_S)

    def _write_all(self) -> None:
        while (data := self._next()) is not None:
            rest = data
            try:
                while rest:
                    rest = rest[os.write(self._descriptor, rest) :]
            except OSError:
                return
            with self._changed:
                self._bytes = max(0, self._bytes - len(data))

    def _next(self) -> bytes | None:
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._dropped or self._ended)
            if self._waiting:
                return self._waiting.popleft()
            if not self._dropped:
                return None
            dropped, self._dropped = self._dropped, 0
            return f"… {dropped} lines are not here, as nobody read them in time\n".encode()


@contextmanager
def printing_aside() -> Iterator[None]:
    """Let threads write the standard output and errors of this block; see :class:`AsideOutput`.

    The errors include the log lines of ROS, which are not written with Python.
    """
    sys.stdout.flush()
    with _aside("stdout", sys.stdout.fileno()), _errors_aside():
        yield


@contextmanager
def _aside(stream: str, descriptor: int) -> Iterator[AsideOutput]:
    """Let a thread write a stream of ``sys`` to a descriptor within this block."""
    before = getattr(sys, stream)
    output = AsideOutput(descriptor)
    aside = io.TextIOWrapper(
        io.BufferedWriter(output),
        encoding=before.encoding,
        errors=before.errors,
        line_buffering=True,
    )
    setattr(sys, stream, aside)
    try:
        yield output
    finally:
        setattr(sys, stream, before)
        aside.flush()
        output.end()
        aside.detach()


@contextmanager
def _errors_aside() -> Iterator[None]:
    """Let threads write the standard errors of Python, and those that C writes into a pipe."""
    try:
        before = os.dup(_ERRORS)
    except OSError:  # closed by the caller of the command
        yield
        return
    reading, writing = os.pipe()
    # A log line that does not fit is lost: its writer may keep the emptying thread from running.
    os.set_blocking(writing, False)
    with _aside("stderr", before) as output:

        def empty() -> None:
            with open(reading, "rb", buffering=0) as pipe:
                while data := pipe.read(_PIPE_BYTES):
                    output.write(data)

        thread = threading.Thread(target=empty, name="errors", daemon=True)
        thread.start()
        os.dup2(writing, _ERRORS)
        os.close(writing)
        try:
            yield
        finally:
            os.dup2(before, _ERRORS)
            thread.join(END_LIMIT_S)
