# SPDX-License-Identifier: Apache-2.0
"""Notices that files have changed, by looking again and again: it works on every file system."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

PERIOD_S = 0.5
"""How often files are looked at [s]."""

Stamp = tuple[int, ...]
"""Tells a change of a file: times of change [ns], size, and the number of the file."""

Look = Callable[[], Mapping[str, Stamp]]
"""Returns for each file by which a change of it can be told."""

_DEEPEST = 8
"""Folders in folders that are looked at; links may lead in circles."""


def poll(paths: Iterable[Path], suffixes: tuple[str, ...]) -> dict[str, Stamp]:
    """Return the stamp of each file; in folders, of those with a suffix and no hidden ones."""
    seen: dict[str, Stamp] = {}
    for path in paths:
        if path.is_dir():
            _look_into(str(path), suffixes, seen, _DEEPEST)
        else:
            _look(str(path), seen)
    return seen


def differing(before: Mapping[str, Stamp], after: Mapping[str, Stamp]) -> tuple[str, ...]:
    """Return the files that are new, changed or gone between two looks, by name."""
    if before == after:
        return ()
    names = {*before, *after}
    return tuple(sorted(name for name in names if before.get(name) != after.get(name)))


def changes(look: Look, sleep: Callable[[float], None]) -> Iterator[tuple[str, ...]]:
    """Return the files that have changed since this call or the last time, when some have.

    Args:
        look: What is looked at.
        sleep: Waits so many seconds; ends the watch by raising ``KeyboardInterrupt``.
    """
    return _changes(look(), look, sleep)


def _changes(
    before: Mapping[str, Stamp], look: Look, sleep: Callable[[float], None]
) -> Iterator[tuple[str, ...]]:
    while True:
        sleep(PERIOD_S)
        after = look()
        changed = differing(before, after)
        before = after
        if changed:
            yield changed


def _look_into(
    folder: str, suffixes: tuple[str, ...], seen: dict[str, Stamp], deeper: int
) -> None:
    try:
        with os.scandir(folder) as entries:
            found = [entry for entry in entries if not entry.name.startswith(".")]
    except OSError:
        # Editors replace files; what is gone now is back at the next look.
        return
    for entry in found:
        if entry.name.endswith(suffixes):
            _look(os.path.join(folder, entry.name), seen)
        try:
            is_folder = entry.is_dir()
        except OSError:
            continue
        if is_folder and deeper:
            _look_into(os.path.join(folder, entry.name), suffixes, seen, deeper - 1)


def _look(file: str, seen: dict[str, Stamp]) -> None:
    try:
        try:
            found = os.stat(file)
        except OSError:
            # A link that leads nowhere is there, and a problem.
            found = os.lstat(file)
    except OSError:
        return
    seen[file] = (found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino)
