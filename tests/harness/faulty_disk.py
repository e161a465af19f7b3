# SPDX-License-Identifier: Apache-2.0
"""A disk whose jobs a test does itself, or that are done at once."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class Disk(Executor):
    """Stands for the thread that waits for the disk.

    Args:
        at_once: False keeps the jobs until :meth:`turn`.

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
        """Do everything that waits."""
        while self.jobs:
            self.jobs.pop(0)()
