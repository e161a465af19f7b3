# SPDX-License-Identifier: Apache-2.0
"""ROS domains of this machine, held by lock files for the life of a process."""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from bt_agents_core.errors import BtAgentsError

FIRST, LAST = 40, 100
"""Private use on every platform, with ports below the ephemeral ones of Linux."""

_LONGEST_WORDS = 300
_TRIES = 3
_TRY_S = 0.02


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

    Args:
        domain: The ROS domain.
        who: Words for whoever wants it too.

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
    if not _locked(lock):
        other = _words(lock)
        os.close(lock)
        raise BtAgentsError(
            f"a system already runs on ROS domain {domain}: {other}; end it, or set ROS_DOMAIN_ID "
            "to another number",
        )
    with suppress(OSError):  # another user's file cannot be written, the lock holds all the same
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"{who}\n".encode()[:_LONGEST_WORDS], 0)


def holder(domain: int) -> str:
    """Return who runs a system on a domain, in the words of :func:`hold_domain`.

    Empty when no process of this machine does.
    """
    try:
        lock = os.open(_lock_file(domain), os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:
        return ""
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _words(lock)
    else:
        return ""
    finally:
        os.close(lock)


def _lock_file(domain: int) -> Path:
    return Path(tempfile.gettempdir()) / f"bt-agents-system-{domain}.lock"


def _locked(lock: int) -> bool:
    """Return whether the lock is ours now; :func:`holder` may have it for an instant."""
    for _ in range(_TRIES):
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(_TRY_S)
        else:
            return True
    return False


def _words(lock: int) -> str:
    words = os.pread(lock, _LONGEST_WORDS, 0).decode(errors="replace").strip()
    return words or "a process that says no name"


def _open_lock(path: Path) -> int:
    """Return the open file, to be written unless it is another user's."""
    try:
        return os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o644)
    except PermissionError:
        return os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
