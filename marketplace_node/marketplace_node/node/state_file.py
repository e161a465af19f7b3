# SPDX-License-Identifier: Apache-2.0
"""State file of the market: read once, written by its own thread."""

from __future__ import annotations

import os
import time
from concurrent.futures import Future, wait
from contextlib import suppress
from pathlib import Path

from rclpy.node import Node

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.private_files import make_private_file, make_private_folder
from bt_agents_core.worker_thread import WorkerThread
from bt_agents_ros.timers import FuturePoller

_MOST_BYTES = 16 * 1024 * 1024
_WRITTEN_S = 0.25
"""Longest wait for a text to be written [s], hundreds of times what an idle disk needs."""


class StateFile:
    """Text file; the first write creates it with its folder.

    Args:
        node: Logs errors.
        path: The file.
        what: Description of the content.
        durable: Whether the text also survives a power cut, a moment after it was stored.
    """

    def __init__(self, node: Node, path: Path, what: str, *, durable: bool) -> None:
        self._node = node
        self._path = path
        self._what = what
        self._durable = durable
        self._poller = FuturePoller(node)
        self._worker = WorkerThread(f"file of {what}")
        self._last: Future[None] | None = None
        self._waited: Future[None] | None = None

    def read(self) -> str:
        """Return the stored text; empty without one."""
        try:
            with self._path.open("rb") as opened:
                stored = opened.read(_MOST_BYTES + 1)
            if len(stored) > _MOST_BYTES:
                self._report(f"{self._path} has more than {_MOST_BYTES} bytes")
                return ""
            return stored.decode("utf-8")
        except FileNotFoundError:
            return ""
        except (OSError, UnicodeDecodeError) as error:
            self._report(str(error))
            return ""

    def age_s(self) -> float:
        """Return the time since the file was written or touched [s]; 0 without a file."""
        with suppress(OSError):
            return max(0.0, time.time() - self._path.stat().st_mtime)
        return 0.0

    def store(self, text: str, *, at_once: bool) -> None:
        """Replace the stored text.

        Args:
            text: The new text.
            at_once: Whether to wait until the text is written, so that it survives a kill of the
                process right after the call. The wait is at most 0.25 s, and 0 while an earlier
                write hangs.
        """
        if at_once:
            hangs = self._waited is not None and not self._waited.done()
            self._waited = self._submit(text, durable=False)
            if not hangs:
                wait([self._waited], _WRITTEN_S)
        if self._durable or not at_once:
            self._submit(text, durable=self._durable)

    def touch(self) -> None:
        """Mark in the file that its writer is alive, unless a write is in progress."""
        if self._last is not None and self._last.done():
            self._last = self._worker.submit(self._touch)

    def close(self) -> None:
        """Write the pending text."""
        self._worker.shutdown()

    def _submit(self, text: str, *, durable: bool) -> Future[None]:
        self._last = self._worker.submit(self._write, text, durable)
        self._poller.watch(self._last, self._report)
        return self._last

    def _write(self, text: str, durable: bool) -> None:
        make_private_folder(self._path.parent)
        make_private_file(self._path)
        write_atomically(self._path, text, durable=durable)

    def _touch(self) -> None:
        with suppress(OSError):
            os.utime(self._path)

    def _report(self, error: str) -> None:
        if error:
            self._node.get_logger().error(
                f"{self._what} are not kept over a restart of the market: {error}"
            )
