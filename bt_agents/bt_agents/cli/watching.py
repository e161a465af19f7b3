# SPDX-License-Identifier: Apache-2.0
"""Notices that files have changed, by looking again and again: it works on every file system."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

PERIOD_S = 0.5
"""How often files are looked at [s]."""

Look = Callable[[], Mapping[str, tuple[int, int]]]
"""Returns for each file by which a change of it can be told."""


def look_at(paths: Iterable[Path], suffixes: tuple[str, ...]) -> dict[str, tuple[int, int]]:
    """Return time of change [ns] and size of each file, those in folders by their suffix."""
    seen: dict[str, tuple[int, int]] = {}
    for path in paths:
        files = path.rglob("*") if path.is_dir() else (path,)
        for file in files:
            if file is not path and file.suffix not in suffixes:
                continue
            try:
                found = file.stat()
            except OSError:
                # Editors replace files; one that is gone now is back at the next look.
                continue
            seen[str(file)] = (found.st_mtime_ns, found.st_size)
    return seen


def changes(look: Look, sleep: Callable[[float], None]) -> Iterator[tuple[str, ...]]:
    """Return the files that have changed since this call or the last time, when some have.

    Args:
        look: What is looked at.
        sleep: Waits so many seconds; ends the watch by raising ``KeyboardInterrupt``.
    """
    return _changes(look(), look, sleep)


def _changes(
    before: Mapping[str, tuple[int, int]], look: Look, sleep: Callable[[float], None]
) -> Iterator[tuple[str, ...]]:
    while True:
        sleep(PERIOD_S)
        after = look()
        names = {*before, *after}
        changed = tuple(sorted(name for name in names if before.get(name) != after.get(name)))
        before = after
        if changed:
            yield changed
