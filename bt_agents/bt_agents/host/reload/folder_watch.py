# SPDX-License-Identifier: Apache-2.0
"""Watches a trees folder: polls it, and reads changed files once they are stable."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from bt_agents.host.reload.incremental_reader import KnownFiles, Rereading, known_files
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.file_watch import Stamp, differing, poll
from bt_agents_language.files.folder_reader import SUFFIXES, Trees

MAX_UNSETTLED_POLLS = 6
"""Polls after which files are read even if some file in the folder keeps changing."""


class WatchStopped(BtAgentsError):
    """Ends a reading after :meth:`FolderWatch.stop`."""


class FolderWatch:
    """Watch of one trees folder, starting from its first reading; used by one thread only.

    ``pause`` yields to other threads before each file is read.
    """

    def __init__(self, trees: Trees, pause: Callable[[], None] = lambda: None) -> None:
        self._folder = trees.folder
        self._known: KnownFiles = known_files(trees)
        self._pause = pause
        self._stopped = False
        self._last_poll: dict[str, Stamp] | None = None
        self._read: dict[str, Stamp] = {}
        self._unsettled_polls = 0
        self._missing_text = ""

    def stop(self) -> None:
        """Make a reading in progress raise :class:`WatchStopped`; callable from any thread."""
        self._stopped = True

    def poll(self, *, settle: bool = True) -> Trees | None:
        """Return the folder if it has changed since the last call, else None.

        Args:
            settle: True defers files that differ between two polls to the next one, because they
                are still being written; False reads them as they are.

        Raises:
            WatchStopped: See :meth:`stop`.
        """
        gone = self._missing()
        if gone:
            is_new = gone != self._missing_text
            self._missing_text = gone
            return self._trees() if is_new else None
        back, self._missing_text = bool(self._missing_text), ""
        now = dict(poll([self._folder], SUFFIXES))
        still = now == self._last_poll
        self._last_poll = now
        changed = differing(self._read, now)
        if not changed or (settle and not still and self._unsettled_polls < MAX_UNSETTLED_POLLS):
            self._unsettled_polls = self._unsettled_polls + 1 if changed else 0
            return self._trees() if back else None
        self._unsettled_polls = 0
        before = self._known
        reading = Rereading(before, {*map(Path, now)}, {*map(Path, changed)}, self._before_file)
        self._known = reading.result()
        self._read = now
        return self._trees() if back or self._known is not before else None

    def _missing(self) -> str:
        trees, skills = self._known.trees, self._folder / "skills"
        needed = [self._folder]
        if trees.files:
            needed.append(self._folder / "agents")
        if any(path.parent == skills for path in trees.texts):
            needed.append(skills)
        for folder in needed:
            try:
                os.scandir(folder).close()
            except OSError as error:
                return (
                    f"the folder {folder} cannot be read ({error.strerror}); all agents stay as "
                    "they are until it can"
                )
        return ""

    def _trees(self) -> Trees:
        trees = self._known.trees
        if not self._missing_text:
            return trees
        return replace(trees, problems=(*trees.problems, self._missing_text))

    def _before_file(self) -> None:
        if self._stopped:
            raise WatchStopped("reading was stopped")
        self._pause()
