# SPDX-License-Identifier: Apache-2.0
"""An executor that runs its jobs at once, or when a test tells it to."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class Disk(Executor):
    """Executor in place of the thread that writes to the disk.

    Args:
        at_once: False holds jobs back until :meth:`turn`.

    Attributes:
        at_once: Whether jobs run at once.
        jobs: Pending jobs.
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
