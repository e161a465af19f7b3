# SPDX-License-Identifier: Apache-2.0
"""ROS domains of this machine, held by lock files for the life of a process."""

from __future__ import annotations

import fcntl
import os
import tempfile
from contextlib import suppress
from pathlib import Path

from bt_agents.errors import BtAgentsError

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


_LONGEST_WORDS = 300


def hold_domain(domain: int, who: str) -> None:
    """Make this process the only one that runs a system on a domain, however it ends.

    Args:
        domain: The ROS domain.
        who: Words for whoever wants it too.

    Raises:
        BtAgentsError: Another process of this machine holds it, or the lock file cannot be used.
    """
    path = Path(tempfile.gettempdir()) / f"bt-agents-system-{domain}.lock"
    try:
        lock = _open_lock(path)
    except OSError as error:
        raise BtAgentsError(
            f"the lock file {path} cannot be opened ({error.strerror}); remove it"
        ) from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        other = os.pread(lock, _LONGEST_WORDS, 0).decode(errors="replace").strip()
        os.close(lock)
        raise BtAgentsError(
            f"a system already runs on ROS domain {domain}: {other or 'it says no name'}; end it, "
            "or set ROS_DOMAIN_ID to another number",
        ) from None
    with suppress(OSError):  # another user's file cannot be written, the lock holds all the same
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"{who}\n".encode()[:_LONGEST_WORDS], 0)


def _open_lock(path: Path) -> int:
    """Return the open file, to be written unless it is another user's."""
    try:
        return os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o644)
    except PermissionError:
        return os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
