# SPDX-License-Identifier: Apache-2.0
"""Nodes that are destroyed within a bounded time, or else the process ends.

The last node of a process ends its participant. Fast DDS 2.14 then waits without a limit for
discovery callbacks; compiled with GCC 9, as for the ROS wheels, this wait holds the lock that such
a callback needs, and rclpy holds the GIL (eProsima/Fast-DDS#6513). Remove this module when Fast
DDS ends a participant while it discovers another.
"""

from __future__ import annotations

import faulthandler
from collections.abc import Iterator
from contextlib import contextmanager

END_LIMIT_S = 5.0
"""Longest time to destroy nodes [s]."""

_ERRORS = 2


@contextmanager
def ending_in_time() -> Iterator[None]:
    """Destroy nodes in this block; one that takes too long ends the process with exit code 1."""
    faulthandler.dump_traceback_later(END_LIMIT_S, exit=True, file=_ERRORS)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
