# SPDX-License-Identifier: Apache-2.0
"""Incremental reading of a trees folder: unchanged files and agents stay the same objects."""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from bt_agents_core.errors import ReadError
from bt_agents_language.files.agent_file import AgentFile, read_agent_file
from bt_agents_language.files.folder_reader import (
    TEST_SUFFIXES,
    BrokenFile,
    Trees,
    broken_files,
    is_wanted,
    named,
    plugin_problems,
    text_of,
)
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.files.preset_reader import PRESETS_FOLDER
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.files.texts_reader import FolderTexts
from bt_agents_language.nodes.plugin_discovery import installed_plugins
from bt_agents_language.nodes.symbols import SymbolTable


@dataclass(frozen=True, kw_only=True)
class KnownFiles:
    """Result of the last reading of a trees folder, with its libraries.

    While the skills are broken, the last good ones stay in ``trees``.
    """

    trees: Trees
    libraries: FolderLibraries
    broken_skills: tuple[BrokenFile, ...] = ()


def known_files(trees: Trees) -> KnownFiles:
    """Return the known files of a folder that was just read."""
    return KnownFiles(trees=trees, libraries=_libraries(trees, trees.symbols))


class Rereading:
    """One reading of a folder; files and agents with equal content stay the same objects.

    Args:
        before: State of the last reading.
        listed: All YAML files of the folder.
        changed: Files that may differ from the last reading, and files that are gone.
        pause: Called before each file is read; may raise to give up.
    """

    def __init__(
        self,
        before: KnownFiles,
        listed: Collection[Path],
        changed: Collection[Path],
        pause: Callable[[], None],
    ) -> None:
        self._before = before
        self._folder = before.trees.folder
        self._listed = listed
        self._changed = changed
        self._pause = pause
        self._differing: frozenset[Path] = frozenset()
        self._skills_changed = False

    def result(self) -> KnownFiles:
        """Return the new state; the same object if nothing differs."""
        before, trees = self._before, self._before.trees
        texts = self._texts()
        self._differing = frozenset(
            path for path in {*texts, *trees.texts} if texts.get(path) != trees.texts.get(path)
        )
        scene = self._folder / "scene.yaml"
        problems = trees.problems
        if scene in self._changed:
            # The scene read at the start stays in force, and so does its text.
            unchanged = text_of(scene) == trees.texts.get(scene)
            problems = () if unchanged else (f"{scene} has changed; restart everything to use it",)
        if any(path.parent == self._folder / "skills" for path in self._differing):
            before = self._with_skills(before)
        if self._differing:
            before = replace(before, libraries=_libraries(before.trees, before.trees.symbols))
        files = self._files(before)
        same = len(files) == len(trees.files) and all(map(operator.is_, files, trees.files))
        if same and not self._differing and problems == trees.problems:
            return self._before
        renewed = _with_files(before, files, before.libraries.symbols)
        return replace(before, trees=replace(renewed, texts=texts, problems=problems))

    def _texts(self) -> Mapping[Path, str | None]:
        """Return the current texts of the files that agents share."""
        texts = dict(self._before.trees.texts)
        for path in self._changed:
            first = path.relative_to(self._folder).parts[0]
            if first in ("agents", "scripts", "scenes", PRESETS_FOLDER, "scene.yaml"):
                continue
            if path in self._listed:
                texts[path] = text_of(path)
            else:
                texts.pop(path, None)
        return texts

    def _with_skills(self, before: KnownFiles) -> KnownFiles:
        trees, paths = before.trees, self._own_files("skills")
        try:
            skills = read_skills(paths, trees.symbols.interfaces, trees.robot)
        except ReadError as error:
            broken = BrokenFile(file=self._folder / "skills", error=error)
            return replace(before, broken_skills=(broken,))
        self._skills_changed = True
        symbols = replace(
            trees.symbols, skills=skills, plugins=installed_plugins().without(skills).kinds
        )
        return replace(before, trees=replace(trees, symbols=symbols), broken_skills=())

    def _own_files(self, name: str) -> list[Path]:
        """Return the files of a folder except tests."""
        folder = self._folder / name
        return sorted(
            path
            for path in self._listed
            if path.parent == folder and not path.name.endswith(TEST_SUFFIXES)
        )

    def _files(self, before: KnownFiles) -> list[AgentFile]:
        had = {one.file: one for one in self._before.trees.files}
        shared = frozenset(path.relative_to(self._folder).as_posix() for path in self._differing)
        paths = self._own_files("agents")
        return [self._file(path, had.get(path), shared, before.libraries) for path in paths]

    def _file(
        self,
        path: Path,
        before: AgentFile | None,
        shared: frozenset[str],
        libraries: FolderLibraries,
    ) -> AgentFile:
        if before is not None and before.agent is not None:
            depends = self._skills_changed or not before.imports.isdisjoint(shared)
            if not depends and (path not in self._changed or text_of(path) == before.text):
                return before
        self._pause()
        after = read_agent_file(path, libraries)
        if before is None:
            return after
        if (before.text, before.agent, _lines(before)) == (after.text, after.agent, _lines(after)):
            return before
        if before.agent is not None and after.agent is not None:
            # Computed here, in the reading thread, where no callback waits for it.
            assert before.prints
            assert after.prints
        return after


def _libraries(trees: Trees, symbols: SymbolTable) -> FolderLibraries:
    texts = FolderTexts(trees.folder, trees.language)
    return FolderLibraries(trees.folder, replace(symbols, libraries=None), trees.robot, texts)


def _with_files(before: KnownFiles, files: list[AgentFile], symbols: SymbolTable) -> Trees:
    trees, libraries = before.trees, before.libraries
    agents, given, holders = named(files, trees.holders)
    return replace(
        trees,
        symbols=symbols,
        agents=tuple(agent for agent in agents if is_wanted(agent, trees.tags)),
        broken=(*before.broken_skills, *broken_files(given, trees.folder, libraries)),
        plugin_problems=plugin_problems(libraries),
        files=tuple(given),
        holders=holders,
    )


def _lines(file: AgentFile) -> tuple[str, ...]:
    return file.error.lines if file.error is not None else ()
