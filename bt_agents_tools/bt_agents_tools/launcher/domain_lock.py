# SPDX-License-Identifier: Apache-2.0
"""Locks on ROS domains of this machine, held by files for the life of a process."""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from bt_agents_core.errors import BtAgentsError

FIRST, LAST = 40, 100
"""Domains for private use on every platform, with ports below the ephemeral ones of Linux."""

_LONGEST_NAME = 300


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


def hold_domain(domain: int, who: str) -> None:
    """Make this process the only one that runs a system on a domain, however it ends.

    The message to another that wants the domain, too, says ``who`` has it.

    Raises:
        BtAgentsError: Another process of this machine holds it, or the lock file cannot be used.
    """
    path = _lock_file(domain)
    try:
        lock = _open_lock(path)
    except OSError as error:
        raise BtAgentsError(
            f"the lock file {path} cannot be opened ({error.strerror}); remove it"
        ) from None
    if not _take_lock(lock):
        other = _name_in(lock)
        os.close(lock)
        raise BtAgentsError(
            f"a system already runs on ROS domain {domain}: {other}; end it, or set ROS_DOMAIN_ID "
            "to another number"
        )
    with suppress(OSError):  # another user's file cannot be written, the lock holds all the same
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"{who}\n".encode()[:_LONGEST_NAME], 0)


def holder(domain: int) -> str:
    """Return the name of the system on a domain, as given to :func:`hold_domain`.

    Empty when no process of this machine runs one there.
    """
    try:
        lock = os.open(_lock_file(domain), os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:
        return ""
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _name_in(lock)
    else:
        return ""
    finally:
        os.close(lock)


def _lock_file(domain: int) -> Path:
    return Path(tempfile.gettempdir()) / f"bt-agents-system-{domain}.lock"


def _take_lock(lock: int) -> bool:
    """Take the lock; return False if another holds it (:func:`holder` does for an instant)."""
    for _ in range(3):
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.02)
        else:
            return True
    return False


def _name_in(lock: int) -> str:
    name = os.pread(lock, _LONGEST_NAME, 0).decode(errors="replace").strip()
    return name or "a process without a name"


def _open_lock(path: Path) -> int:
    """Open the file for writing, or for reading when it is another user's."""
    try:
        return os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o644)
    except PermissionError:
        return os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
