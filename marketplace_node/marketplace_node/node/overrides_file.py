# SPDX-License-Identifier: Apache-2.0
"""Keeps pins, vetoes and counts in a file for a market that dies and is started again."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.worker_thread import WorkerThread
from bt_agents_ros.future_poller import FuturePoller


class OverridesFile:
    """A file that is read once and written by a thread of its own.

    Args:
        node: Tells what goes wrong.
        path: The file; its folder is made when absent.
    """

    def __init__(self, node: Node, path: Path) -> None:
        self._node = node
        self._path = path
        self._jobs = FuturePoller(node)
        self._worker = WorkerThread("orders")

    def read(self) -> str:
        """Return what was kept; empty when nothing was."""
        try:
            return self._path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return ""
        except (OSError, UnicodeDecodeError) as error:
            self._tell(str(error))
            return ""

    def keep(self, text: str) -> None:
        """Write what is to be kept from now on."""
        self._jobs.watch(self._worker.submit(self._write, text), self._tell)

    def close(self) -> None:
        """Write what still waits to be written."""
        self._worker.shutdown()

    def _write(self, text: str) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._path.touch()
        write_atomically(self._path, text)

    def _tell(self, what: str) -> None:
        if what:
            self._node.get_logger().error(
                f"pins, vetoes and counts are not kept over a restart of the market: {what}"
            )
