# SPDX-License-Identifier: Apache-2.0
"""Looks at a trees folder again and again, and reads what has changed once it stands still."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from pathlib import Path

from bt_agents.host.reload.incremental_reader import KnownFiles, adopted, known_files, reread
from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.file_watch import Look, Stamp, differing, poll
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.files.folder_reader import SUFFIXES, Trees, text_of

PATIENCE_LOOKS = 6
"""Looks after which files are read although some file of the folder changes all the time."""


class WatchStopped(BtAgentsError):
    """Nobody wants to know any more what the folder says."""


@dataclass(frozen=True, kw_only=True)
class FileWrite:
    """What has become of a text that was to be written into an agent file.

    Attributes:
        trees: The folder with it.
        file: The file with it; None when it could not be written.
        words: What was done, for people; empty when there was nothing to do.
    """

    trees: Trees
    file: AgentFile | None
    words: str


class FolderWatch:
    """The files of one trees folder; everything here is done by one thread, one after the other.

    Args:
        trees: The folder as it was read at the start.
        pause: Called before each file is read, so that others get their turn.
        look: Returns the stamp of every YAML file of the folder.
    """

    def __init__(
        self, trees: Trees, pause: Callable[[], None] = lambda: None, look: Look | None = None
    ) -> None:
        self._folder = trees.folder
        self._known: KnownFiles = known_files(trees)
        self._pause = pause
        self._look = look or (lambda: poll([self._folder], SUFFIXES))
        self._stopped = False
        self._seen: dict[str, Stamp] | None = None
        self._read: dict[str, Stamp] = {}
        self._moving = 0
        self._gone = ""

    def stop(self) -> None:
        """Let a reading that is under way raise :class:`WatchStopped`; for any thread."""
        self._stopped = True

    def look(self, *, settle: bool = True) -> Trees | None:
        """Return the folder when it differs from the last time; None while nothing is new.

        Args:
            settle: Files that differ between two looks are still being written and wait for the
                next one; False reads them as they are.

        Raises:
            Stopped: See :meth:`stop`.
        """
        gone = self._missing()
        if gone:
            news = gone != self._gone
            self._gone = gone
            return self._answer() if news else None
        back, self._gone = bool(self._gone), ""
        now = dict(self._look())
        still = now == self._seen
        self._seen = now
        changed = differing(self._read, now)
        if not changed or (settle and not still and self._moving < PATIENCE_LOOKS):
            self._moving = self._moving + 1 if changed else 0
            return self._answer() if back else None
        self._moving = 0
        before = self._known
        paths = {Path(name) for name in now}
        self._known = reread(before, paths, {*map(Path, changed)}, self._turn)
        self._read = now
        return self._answer() if back or self._known is not before else None

    def write(self, path: Path, version: AgentFile, known_texts: Collection[str]) -> FileWrite:
        """Write an earlier text of an agent into its file, which counts as read with that.

        A text that would be lost is kept beside it, in a file with a ``~`` behind its name.

        Args:
            path: The file.
            version: What is to stand there.
            known_texts: Texts that are kept elsewhere.
        """
        assert version.text is not None
        assert version.agent is not None
        found = text_of(path)
        words = ""
        if found != version.text:
            try:
                if found is not None and found not in known_texts:
                    Path(f"{path}~").write_text(found, encoding="utf-8", newline="")
                    words = f"what stood in {path.name} is kept in {path.name}~"
                write_atomically(path, version.text)
            except OSError as error:
                words = f"{path} could not be written ({error.strerror}) and holds another text"
                return FileWrite(trees=self._answer(), file=None, words=words)
        agent = replace(version.agent, file=str(path))
        file = replace(version, file=path, agent=agent)
        # Worked out here, where nobody waits for it.
        assert file.prints
        self._known = adopted(self._known, file)
        return FileWrite(trees=self._answer(), file=file, words=words)

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

    def _answer(self) -> Trees:
        trees = self._known.trees
        return replace(trees, problems=(*trees.problems, self._gone)) if self._gone else trees

    def _turn(self) -> None:
        if self._stopped:
            raise WatchStopped("reading was stopped")
        self._pause()
