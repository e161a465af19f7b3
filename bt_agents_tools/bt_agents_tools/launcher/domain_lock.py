# SPDX-License-Identifier: Apache-2.0
"""Locks on ROS domains of this machine, held by files for the life of a process.

The files are in a folder of the user, where nobody else can hold them. Bound ports and
marketplaces reveal the domains of other users.
"""

from __future__ import annotations

import fcntl
import os
import socket
import stat
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.private_files import make_private_folder, open_private
from bt_agents_core.state_folder import state_home

FIRST, LAST = 40, 100
"""Domains for private use on every platform, with ports below the ephemeral ones of Linux."""

MOST_JOINING = 4
"""Maximum number of commands that join a domain at the same time."""

JOIN_LIMIT_S = 30.0
"""Longest wait of a command for its turn to join a domain [s]."""

LOGINS = Path("/run/user")
"""The login of a user makes a runtime folder in this one."""

_LONGEST_NAME = 300
_TURN_POLL_S = 0.2
_FIRST_PORT, _PORTS_OF_A_DOMAIN, _PORTS_OF_A_PARTICIPANT = 7410, 250, 2
_MOST_PARTICIPANTS = 120
"""Port of the first participant of domain 0, and the numbers of ports and participants in RTPS."""


def runtime_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the runtime folder of this user, which is made if missing.

    It is ``XDG_RUNTIME_DIR``, else the folder that the login of the user would set, else one for
    this machine next to the state folders of the user. Only if that is not writable, it is in the
    folder for temporary files, where another user may have taken its name.

    Raises:
        BtAgentsError: No folder is owned by this user and writable for nobody else.
    """
    user = os.geteuid()
    named = environment.get("XDG_RUNTIME_DIR", "")
    for folder in (Path(named), LOGINS / str(user)):
        if folder.is_absolute() and _is_private(folder):
            return folder
    made = [Path(tempfile.gettempdir()) / f"bt-agents-{user}"]
    with suppress(BtAgentsError):
        machine = quote(socket.gethostname(), safe="")
        made.insert(0, state_home(environment) / f"locks-{machine}")
    for folder in made:
        with suppress(OSError):
            make_private_folder(folder)
        if _is_private(folder):
            return folder
    raise BtAgentsError(
        "no place for the locks of ROS domains: "
        f"{' and '.join(map(str, made))} cannot be made, or others can write there; set "
        "XDG_RUNTIME_DIR to a folder of yours"
    )


def current_domain() -> int:
    """Return the ROS domain of this process."""
    return int(os.environ.get("ROS_DOMAIN_ID") or "0")


def reserve_domain() -> int:
    """Return a free domain id, which no other process of this user holds, and lock it.

    The lock ends with the process, however that ends.

    Raises:
        BtAgentsError: As in :func:`runtime_folder`.
        RuntimeError: All domains are taken.
    """
    folder = runtime_folder()
    for domain in range(FIRST, LAST + 1):
        lock = _locked(folder / f"bt-agents-domain-{domain}.lock")
        if lock is None:
            continue
        if not _is_used(domain):
            return domain
        os.close(lock)
    raise RuntimeError(
        f"no free ROS domain between {FIRST} and {LAST}; end another demo or test run"
    )


def hold_domain(domain: int, who: str, part: str = "") -> None:
    """Make this process the only one that runs a system on a domain; the lock ends with it.

    With the name of a ``part``, it may run along with other parts. ``who`` names the holder in the
    message to another process that wants the same lock.

    Raises:
        BtAgentsError: Another process of this user holds it, or the lock file cannot be used.
    """
    path = _lock_file(domain, part)
    try:
        lock = open_private(path, os.O_RDWR | os.O_NOFOLLOW)
    except OSError as error:
        raise BtAgentsError(
            f"the lock file {path} cannot be opened ({error.strerror}); remove it"
        ) from None
    if not _take_lock(lock):
        other = _name_in(lock)
        os.close(lock)
        raise BtAgentsError(
            f"{f'the part {part}' if part else 'a system'} already runs on ROS domain {domain}: "
            f"{other}; end it, or set ROS_DOMAIN_ID to another number"
        )
    os.ftruncate(lock, 0)
    os.pwrite(lock, f"{who}\n".encode()[:_LONGEST_NAME], 0)


def holder(domain: int) -> str:
    """Return the name of the system on a domain, as given to :func:`hold_domain`.

    It is empty if no process of this user runs a system there.
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


@contextmanager
def turn_to_join(domain: int, limit_s: float = JOIN_LIMIT_S) -> Iterator[None]:
    """Join a domain when fewer than :data:`MOST_JOINING` commands of this user are joining it.

    Each joining process and every other discover each other: many at once would keep the machine
    busy. After ``limit_s`` the process joins anyway.

    Raises:
        BtAgentsError: As in :func:`runtime_folder`.
    """
    folder = runtime_folder()
    turns = [folder / f"bt-agents-join-{domain}-{turn}.lock" for turn in range(MOST_JOINING)]
    end = time.monotonic() + limit_s
    while (lock := _first_locked(turns)) is None and time.monotonic() < end:
        time.sleep(_TURN_POLL_S)
    try:
        yield
    finally:
        if lock is not None:
            os.close(lock)


def _first_locked(files: Iterable[Path]) -> int | None:
    """Lock the first file that no other process has locked; None if all are."""
    return next((lock for lock in map(_locked, files) if lock is not None), None)


def _locked(file: Path) -> int | None:
    """Return a lock, which lasts until it is closed; None if another process holds it."""
    lock = open_private(file, os.O_WRONLY | os.O_NOFOLLOW)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        return None
    return lock


def _lock_file(domain: int, part: str = "") -> Path:
    what = f"part-{part}" if part else "system"
    return runtime_folder() / f"bt-agents-{what}-{domain}.lock"


def _is_private(folder: Path) -> bool:
    """Return whether a path is a folder of this user that nobody else can write to."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return (
        stat.S_ISDIR(found.st_mode)
        and found.st_uid == os.geteuid()
        and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        and os.access(folder, os.W_OK | os.X_OK)
    )


def _is_used(domain: int) -> bool:
    """Return whether a domain has a participant, of any user."""
    first = _FIRST_PORT + _PORTS_OF_A_DOMAIN * domain
    last = first + _PORTS_OF_A_PARTICIPANT * _MOST_PARTICIPANTS
    return not all(map(_is_free, range(first, last, _PORTS_OF_A_PARTICIPANT)))


def _is_free(port: int) -> bool:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _take_lock(lock: int) -> bool:
    """Take the lock; return False if another process holds it (:func:`holder` does briefly)."""
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
