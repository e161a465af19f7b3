# SPDX-License-Identifier: Apache-2.0
"""Folders and files that nobody but their owner can read, whatever the umask."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path

FOLDER_MODE = 0o700
FILE_MODE = 0o600

_OTHERS = 0o077
_OF_A_DATABASE = ("", "-wal", "-shm", "-journal")


def make_private_folder(path: Path, *, within: Path | None = None) -> None:
    """Make a folder, with those above it that are missing.

    Folders that were there keep their rights, as they may hold what is not ours; only
    ``within``, a folder of this program, and those from there down to ``path`` are tightened.

    Raises:
        OSError: It cannot be made, or is no folder.
    """
    missing = []
    for folder in (path, *path.parents):
        if folder.exists():
            break
        missing.append(folder)
    for folder in reversed(missing):
        with suppress(FileExistsError):
            folder.mkdir(mode=FOLDER_MODE)
    # A file in its place, or a link that leads nowhere, is named as one.
    path.mkdir(exist_ok=True)
    for folder in (path, *path.parents):
        if within is None or not folder.is_relative_to(within):
            break
        tighten(folder)


def open_private(path: Path, flags: int) -> int:
    """Open a file, made when it is missing; return its descriptor.

    Raises:
        OSError: As of :func:`os.open`.
    """
    descriptor = os.open(path, flags | os.O_CREAT | os.O_CLOEXEC, FILE_MODE)
    try:
        _tighten(descriptor, os.fstat(descriptor))
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def make_private_file(path: Path) -> None:
    """Make an empty file, or tighten the one that is there.

    Raises:
        OSError: It cannot be made.
    """
    os.close(open_private(path, os.O_WRONLY))


def make_private_database(path: Path) -> None:
    """Make a file for SQLite, or tighten the one that is there with its logs.

    The logs that SQLite makes later have the rights of the file.

    Raises:
        OSError: It cannot be made.
    """
    make_private_file(path)
    for suffix in _OF_A_DATABASE:
        tighten(path.with_name(path.name + suffix))


def tighten(path: Path) -> None:
    """Take all rights of others on a file or folder of this user away, when it is there.

    Folders that everybody may write, such as /tmp, are left as they are.
    """
    with suppress(OSError):
        _tighten(path, path.stat())


def _tighten(target: Path | int, found: os.stat_result) -> None:
    is_ours = found.st_uid == os.geteuid() and not found.st_mode & stat.S_ISVTX
    is_kept = stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)
    if not (is_ours and is_kept):
        return
    if found.st_mode & _OTHERS:
        os.chmod(target, stat.S_IMODE(found.st_mode) & ~_OTHERS)
