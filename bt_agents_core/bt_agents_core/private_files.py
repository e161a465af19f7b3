# SPDX-License-Identifier: Apache-2.0
"""Folders and files that only their owner can read, whatever the umask."""

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
    """Make a folder and its missing parents.

    Existing folders keep their permissions, because they may hold files of others; only
    ``within``, a folder of this program, and the folders from there down to ``path`` become
    private.

    Raises:
        OSError: It cannot be made, or is not a folder.
    """
    missing = []
    for folder in (path, *path.parents):
        if folder.exists():
            break
        missing.append(folder)
    for folder in reversed(missing):
        with suppress(FileExistsError):
            folder.mkdir(mode=FOLDER_MODE)
    # The error names a file in its place or a dangling link.
    path.mkdir(exist_ok=True)
    for folder in (path, *path.parents):
        if within is None or not folder.is_relative_to(within):
            break
        tighten(folder)


def open_private(path: Path, flags: int) -> int:
    """Open a file, which is made if missing; return its descriptor.

    Raises:
        OSError: As for :func:`os.open`.
    """
    descriptor = os.open(path, flags | os.O_CREAT | os.O_CLOEXEC, FILE_MODE)
    try:
        _tighten(descriptor, os.fstat(descriptor))
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def make_private_file(path: Path) -> None:
    """Make an empty file, or make an existing one private.

    Raises:
        OSError: It cannot be made.
    """
    os.close(open_private(path, os.O_WRONLY))


def make_private_database(path: Path) -> None:
    """Make a file for SQLite, or make an existing one and its logs private.

    SQLite gives later logs the permissions of the file.

    Raises:
        OSError: It cannot be made.
    """
    make_private_file(path)
    for suffix in _OF_A_DATABASE:
        tighten(path.with_name(path.name + suffix))


def tighten(path: Path) -> None:
    """Remove all permissions of others on a file or folder of this user, if it exists.

    Folders that everybody may write to, such as /tmp, stay unchanged.
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
