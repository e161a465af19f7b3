# SPDX-License-Identifier: Apache-2.0
"""The thread of a host that reads and saves files."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError

import pytest

from bt_agents_core.worker_thread import WorkerThread

HANG_S = 30.0


def test_work_runs_in_order_and_futures_carry_errors() -> None:
    thread, done = WorkerThread("files"), []

    def broken() -> None:
        raise OSError("the folder is gone")

    first = thread.submit(lambda: done.append(1))
    second = thread.submit(broken)
    third = thread.submit(lambda: done.append(3) or "read")
    assert third.result(HANG_S) == "read"
    assert first.result(0) is None
    with pytest.raises(OSError, match="the folder is gone"):
        second.result(0)
    assert done == [1, 3]
    thread.shutdown()
    with pytest.raises(RuntimeError, match="shut down"):
        thread.submit(broken)


def test_waiting_shutdown_finishes_queued_work() -> None:
    thread, done = WorkerThread("files"), []
    for number in range(3):
        thread.submit(lambda number: time.sleep(0.01) or done.append(number), number)
    thread.shutdown()
    assert done == [0, 1, 2]


def test_cancelling_shutdown_drops_queued_work() -> None:
    thread, begun, go = WorkerThread("files"), threading.Event(), threading.Event()
    under_way = thread.submit(lambda: begun.set() or go.wait(HANG_S))
    waiting = thread.submit(lambda: "read")
    assert begun.wait(HANG_S)
    thread.shutdown(wait=False, cancel_futures=True)
    go.set()
    assert under_way.result(HANG_S) is True
    with pytest.raises(CancelledError):
        waiting.result(HANG_S)


def test_process_exits_despite_hanging_work() -> None:
    code = (
        "import threading\n"
        "from bt_agents_core.worker_thread import WorkerThread\n"
        "begun = threading.Event()\n"
        "thread = WorkerThread('files')\n"
        "thread.submit(lambda: (begun.set(), threading.Event().wait()))\n"
        "begun.wait()\n"
        "thread.shutdown(wait=False)\n"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], timeout=HANG_S, check=False).returncode == 0
    )
