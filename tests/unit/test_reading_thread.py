# SPDX-License-Identifier: Apache-2.0
"""The thread that reads files beside a host."""

from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import CancelledError

import pytest

from bt_agents.reload.reading_thread import ReadingThread

HANG_S = 30.0


def test_work_is_done_in_order_and_what_it_raises_is_told_by_its_result() -> None:
    thread, done = ReadingThread(), []

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
    thread.close()


def test_what_still_waits_when_it_is_closed_is_not_done() -> None:
    thread, begun, go = ReadingThread(), threading.Event(), threading.Event()
    under_way = thread.submit(lambda: begun.set() or go.wait(HANG_S))
    waiting = thread.submit(lambda: "read")
    assert begun.wait(HANG_S)
    thread.close()
    go.set()
    assert under_way.result(HANG_S) is True
    with pytest.raises(CancelledError):
        waiting.result(HANG_S)


def test_a_process_ends_although_a_reading_hangs() -> None:
    code = (
        "import threading\n"
        "from bt_agents.reload.reading_thread import ReadingThread\n"
        "begun = threading.Event()\n"
        "thread = ReadingThread()\n"
        "thread.submit(lambda: (begun.set(), threading.Event().wait()))\n"
        "begun.wait()\n"
        "thread.close()\n"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], timeout=HANG_S, check=False).returncode == 0
    )
