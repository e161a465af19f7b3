# SPDX-License-Identifier: Apache-2.0
"""One thread that reads files, for which a process that ends does not wait."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from threading import Thread
from typing import Any


class ReadingThread:
    """Does one piece of work after the other.

    That of :mod:`concurrent.futures` is waited for at the end of a process, however long a file of
    a network folder takes.
    """

    def __init__(self) -> None:
        self._waiting: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._closed = False
        Thread(target=self._work, name="reload", daemon=True).start()

    def submit(self, work: Callable[[], Any]) -> Future[Any]:
        """Have something done; return what tells its result."""
        future: Future[Any] = Future()
        self._waiting.put((future, work))
        return future

    def close(self) -> None:
        """Let what is under way end and give up what waits; nothing is waited for."""
        self._closed = True
        self._waiting.put(None)

    def _work(self) -> None:
        while (one := self._waiting.get()) is not None:
            future, work = one
            if self._closed:
                future.cancel()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(work())
            except Exception as error:
                future.set_exception(error)
