# SPDX-License-Identifier: Apache-2.0
"""Locks on ROS domains of this machine, held by files for the life of a process.

The files lie in a folder of the user, where nobody else can hold them. Of other users
a domain shows itself by the ports that are bound, and by its marketplace.
"""

from __future__ import annotations

import fcntl
import os
import socket
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.private_files import make_private_folder, open_private
from bt_agents_core.state_folder import state_home

FIRST, LAST = 40, 100
"""Domains for private use on every platform, with ports below the ephemeral ones of Linux."""

MOST_JOINING = 4
"""Commands that join a domain at the same time."""

JOIN_LIMIT_S = 30.0
"""Longest wait of a command for its turn to join a domain [s]."""

LOGINS = Path("/run/user")
"""Where the login of a user makes a runtime folder."""

_LONGEST_NAME = 300
_TURN_POLL_S = 0.2
_FIRST_PORT, _PORTS_OF_A_DOMAIN = 7410, 250
"""Port of the first participant of domain 0, and the ports of a domain, as RTPS has it."""


def runtime_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of this user for what lasts as long as a session, made when missing.

    That is ``XDG_RUNTIME_DIR``, else the one that the login of the user would set, else one for
    this machine beside the state folders of the user. Only where that cannot be written it is one
    in the folder for temporary files, where another user may have taken its name.

    Raises:
        BtAgentsError: There is none that this user owns and nobody else can write.
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


def reserve_domain() -> int:
    """Return a domain id that no other process of this user holds, and nobody uses.

    The lock ends with the process, however it ends.

    Raises:
        BtAgentsError: As in :func:`runtime_folder`.
        RuntimeError: All domains are taken.
    """
    folder = runtime_folder()
    for domain in range(FIRST, LAST + 1):
        lock = open_private(folder / f"bt-agents-domain-{domain}.lock", os.O_WRONLY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        if _is_used(domain):
            os.close(lock)
            continue
        return domain
    raise RuntimeError(
        f"no free ROS domain between {FIRST} and {LAST}; end another demo or test run"
    )


def hold_domain(domain: int, who: str, part: str = "") -> None:
    """Make this process the only one that runs a system on a domain, however it ends.

    With the name of a ``part``, that one may run beside other parts. The message to another that
    wants the same, too, says ``who`` has it.

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

    Empty when no process of this user runs one there.
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
    """Join a domain when less than :data:`MOST_JOINING` commands of this user are joining it.

    Each process that joins is told of every other: many at once would keep the machine busy with
    each other. After ``limit_s`` it is joined anyway.

    Raises:
        BtAgentsError: As in :func:`runtime_folder`.
    """
    folder = runtime_folder()
    end = time.monotonic() + limit_s
    lock = -1
    while lock < 0:
        for turn in range(MOST_JOINING):
            path = folder / f"bt-agents-join-{domain}-{turn}.lock"
            lock = open_private(path, os.O_RDWR | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                os.close(lock)
                lock = -1
        else:
            if time.monotonic() >= end:
                break
            time.sleep(_TURN_POLL_S)
    try:
        yield
    finally:
        if lock >= 0:
            os.close(lock)


def _lock_file(domain: int, part: str = "") -> Path:
    what = f"part-{part}" if part else "system"
    return runtime_folder() / f"bt-agents-{what}-{domain}.lock"


def _is_private(folder: Path) -> bool:
    """Return whether something is a folder of this user that nobody else can write."""
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
    """Return whether the first participant of a domain is there, of whichever user."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        try:
            probe.bind(("127.0.0.1", _FIRST_PORT + _PORTS_OF_A_DOMAIN * domain))
        except OSError:
            return True
    return False


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
