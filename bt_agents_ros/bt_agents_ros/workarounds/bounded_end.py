# SPDX-License-Identifier: Apache-2.0
"""End of nodes and of their process within a limited time.

The last node of a process ends its participant. Fast DDS 2.14 then waits without a limit for
discovery callbacks; compiled with GCC 9, as for the ROS wheels, this wait holds the lock that such
a callback needs, and rclpy holds the GIL (eProsima/Fast-DDS#6513). Remove this module when Fast
DDS ends a participant while it discovers another.
"""

from __future__ import annotations

import ctypes
import faulthandler
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

END_LIMIT_S = 3
"""Longest time for the end of a process whose work is done [s]."""

_NODES_LIMIT_S = 4.0
"""Longest time to destroy nodes in a process that goes on [s]."""

_ERRORS = 2
_SIGEV_THREAD = 2


class _Event(ctypes.Structure):
    """``struct sigevent`` of Linux, with a function for its thread."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("padding", ctypes.c_byte * 40),
    )


def limit_end(code: int) -> None:
    """End the process with this exit code, unless it has ended within ``END_LIMIT_S``.

    A thread of the C library ends it, because no Python code can run.
    """
    if sys.platform == "linux":
        library = ctypes.CDLL(None)
        end = ctypes.cast(library._exit, ctypes.c_void_p)
        event = _Event(value=code, notify=_SIGEV_THREAD, function=end.value)
        timer = ctypes.c_void_p()
        library.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer))
        interval_and_value = (ctypes.c_long * 4)(0, 0, END_LIMIT_S, 0)
        library.timer_settime(timer, 0, interval_and_value, None)


@contextmanager
def ending_in_time() -> Iterator[None]:
    """Destroy nodes in this block; one that takes too long ends the process with exit code 1."""
    faulthandler.dump_traceback_later(_NODES_LIMIT_S, exit=True, file=_ERRORS)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
