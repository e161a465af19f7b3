# SPDX-License-Identifier: Apache-2.0
"""Worker thread for slow file access: an executor whose shutdown is bounded in time."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from typing import Any, ParamSpec, TypeVar

LIMIT_S = 5.0
"""Longest time that :meth:`WorkerThread.shutdown` waits [s]."""

_P = ParamSpec("_P")
_T = TypeVar("_T")


class WorkerThread(Executor):
    """Executor with one daemon thread.

    A process does not wait for this thread at its end, unlike for threads of
    :mod:`concurrent.futures`, however long a disk or a network folder takes.
    """

    def __init__(self, name: str) -> None:
        self._waiting: SimpleQueue[tuple[Future[Any], Callable[[], None]] | None]
        self._waiting = SimpleQueue()
        self._lock = Lock()
        self._closed = False
        self._thread = Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        future: Future[_T] = Future()

        def work() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(fn(*args, **kwargs))
            except BaseException as error:
                future.set_exception(error)

        with self._lock:
            if self._closed:
                raise RuntimeError("the worker thread has been shut down")
            self._waiting.put((future, work))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        with self._lock:
            self._closed = True
            while cancel_futures:
                try:
                    one = self._waiting.get_nowait()
                except Empty:
                    break
                if one is not None:
                    one[0].cancel()
            self._waiting.put(None)
        if wait:
            self._thread.join(LIMIT_S)

    def _work(self) -> None:
        while (one := self._waiting.get()) is not None:
            one[1]()
