# SPDX-License-Identifier: Apache-2.0
"""A private ROS domain for demo and tests, held by a lock file for the life of the process."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

FIRST, LAST = 40, 100
"""Private use on every platform, with ports below the ephemeral ones of Linux."""


def reserve_domain() -> int:
    """Return a domain id that no other process of this machine holds.

    The lock ends with the process, however it ends.

    Raises:
        RuntimeError: All domains are taken.
    """
    folder = Path(tempfile.gettempdir())
    for domain in range(FIRST, LAST + 1):
        try:
            lock = os.open(folder / f"bt-agents-domain-{domain}.lock", os.O_CREAT | os.O_WRONLY)
        except PermissionError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        return domain
    raise RuntimeError(
        f"no free ROS domain between {FIRST} and {LAST}; end another demo or test run"
    )
