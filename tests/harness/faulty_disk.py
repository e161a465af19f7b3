# SPDX-License-Identifier: Apache-2.0
"""An executor whose jobs run at once, or when a test says so."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class Disk(Executor):
    """Executor in place of the thread that waits for the disk.

    Args:
        at_once: False holds the jobs back until :meth:`turn`.

    Attributes:
        at_once: Whether jobs are done at once.
        jobs: What waits to be done.
    """

    def __init__(self, *, at_once: bool = True) -> None:
        self.jobs: list[Callable[[], None]] = []
        self.at_once = at_once

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()

        def work() -> None:
            future.set_running_or_notify_cancel()
            try:
                future.set_result(fn(*args, **kwargs))
            except Exception as error:
                future.set_exception(error)

        self.jobs.append(work)
        if self.at_once:
            self.turn()
        return future

    def turn(self) -> None:
        """Run all pending jobs."""
        while self.jobs:
            self.jobs.pop(0)()
