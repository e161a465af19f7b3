# SPDX-License-Identifier: Apache-2.0
"""Agent file as read: its text, the agent or its errors, and its libraries."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from bt_agents_core.errors import ReadError
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.files.texts_reader import AskedTexts
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.nodes.symbols import Library
from bt_agents_language.tree.tree_fingerprint import TreeFingerprint, tree_fingerprint
from bt_agents_language.yaml.source import read_source


@dataclass(frozen=True, kw_only=True)
class AgentFile:
    """Agent file as it was read.

    Attributes:
        text: Its text; None if it could not be opened.
        agent: The agent; None if there are errors.
        error: The errors; None if there are none.
        imports: Paths of the libraries and texts that it directly or indirectly imports.
    """

    file: Path
    text: str | None
    agent: AgentSpec | None
    error: ReadError | None
    imports: frozenset[str]

    @cached_property
    def prints(self) -> tuple[TreeFingerprint, TreeFingerprint]:
        """Fingerprints of the tree and its clean-up, for detecting changes."""
        assert self.agent is not None
        return tree_fingerprint(self.agent.tree), tree_fingerprint(self.agent.on_cancel)


def read_agent_file(path: Path, libraries: FolderLibraries) -> AgentFile:
    """Return an agent file, good or broken."""
    text = agent = error = None
    asked, texts = _Asked(libraries), AskedTexts(libraries.texts)
    try:
        source = read_source(path)
        text = source.text
        agent = read_agent(source, replace(libraries.symbols, libraries=asked, texts=texts))
    except ReadError as problem:
        error = problem
    return AgentFile(
        file=path,
        text=text,
        agent=agent,
        error=error,
        imports=libraries.behind([*asked.paths_loaded, *([texts.path] if texts.asked else [])]),
    )


class _Asked:
    """Libraries of a folder; records which of them one file uses."""

    def __init__(self, libraries: FolderLibraries) -> None:
        self.paths_loaded: set[str] = set()
        self._libraries = libraries

    def load(self, path: str) -> Library:
        self.paths_loaded.add(path)
        return self._libraries.load(path)

    def speaking(self, language: str) -> _Asked:
        self._libraries = self._libraries.speaking(language)
        return self

    def paths(self) -> list[str]:
        return self._libraries.paths()

    def with_subtree(self, name: str) -> list[str]:
        return self._libraries.with_subtree(name)
