# SPDX-License-Identifier: Apache-2.0
"""Polling of files for changes, which works on every file system."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

PERIOD_S = 0.5
"""Polling period [s]."""

Stamp = tuple[int, ...]
"""Fingerprint of a file: times of change [ns], size and inode; differs after every change."""

Poll = Callable[[], Mapping[str, Stamp]]
"""Function that returns the stamp of each file by its name."""

_DEEPEST = 8
"""Maximum depth of polled folders; links may lead in circles."""


def poll(paths: Iterable[Path], suffixes: tuple[str, ...]) -> dict[str, Stamp]:
    """Return the stamp of each file; in folders, of files with a suffix that are not hidden."""
    stamps: dict[str, Stamp] = {}
    for path in paths:
        if path.is_dir():
            _poll_folder(str(path), suffixes, stamps, _DEEPEST)
        else:
            _poll_file(str(path), stamps)
    return stamps


def differing(before: Mapping[str, Stamp], after: Mapping[str, Stamp]) -> tuple[str, ...]:
    """Return the names of the files that are new, changed or gone between two polls."""
    if before == after:
        return ()
    names = {*before, *after}
    return tuple(sorted(name for name in names if before.get(name) != after.get(name)))


def changes(poll_files: Poll, sleep: Callable[[float], None]) -> Iterator[tuple[str, ...]]:
    """Yield the names of changed files whenever some differ from the previous poll.

    The call itself makes the first poll. ``sleep`` waits for a number of seconds; it ends the
    watch by raising ``KeyboardInterrupt``.
    """
    return _changes(poll_files(), poll_files, sleep)


def _changes(
    before: Mapping[str, Stamp], poll_files: Poll, sleep: Callable[[float], None]
) -> Iterator[tuple[str, ...]]:
    while True:
        sleep(PERIOD_S)
        after = poll_files()
        changed = differing(before, after)
        before = after
        if changed:
            yield changed


def _poll_folder(
    folder: str, suffixes: tuple[str, ...], stamps: dict[str, Stamp], deeper: int
) -> None:
    try:
        with os.scandir(folder) as entries:
            found = [entry for entry in entries if not entry.name.startswith(".")]
    except OSError:
        # Editors replace files; a file that is gone now is back at the next poll.
        return
    for entry in found:
        if entry.name.endswith(suffixes):
            _poll_file(os.path.join(folder, entry.name), stamps)
        try:
            is_folder = entry.is_dir()
        except OSError:
            continue
        if is_folder and deeper:
            _poll_folder(os.path.join(folder, entry.name), suffixes, stamps, deeper - 1)


def _poll_file(file: str, stamps: dict[str, Stamp]) -> None:
    try:
        try:
            found = os.stat(file)
        except OSError:
            # A broken link counts as a file.
            found = os.lstat(file)
    except OSError:
        return
    stamps[file] = (found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino)
