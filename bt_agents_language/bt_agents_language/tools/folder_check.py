# SPDX-License-Identifier: Apache-2.0
"""Check of a trees folder, or of some of its files: every diagnostic, for people and programs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from bt_agents_core.diagnostic import Diagnostic, Position
from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_language.diagnostics.collection import merged, warning
from bt_agents_language.fields.interfaces import Interfaces, OfInstalledPackages
from bt_agents_language.files.folder_reader import (
    SUFFIXES,
    TEST_SUFFIXES,
    Trees,
    read_trees,
    yaml_files,
)
from bt_agents_language.files.market_reader import MARKET_FILE, read_market, unknown_agents
from bt_agents_language.files.preset_reader import PRESETS_FOLDER, read_preset, unknown_values
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.files.script_reader import read_script
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.files.testing.test_reader import read_test
from bt_agents_language.files.texts_reader import (
    FOLDER,
    FolderTexts,
    TextFile,
    read_texts,
    uneven_texts,
)
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.nodes.plugin_discovery import installed_plugins
from bt_agents_language.nodes.symbols import ImportProblem, SymbolTable
from bt_agents_language.tools.lint import cut_texts, lint, unused_inputs
from bt_agents_language.yaml.source import Source, read_source

_DEPENDENT = ("libraries", "agents", "scripts", FOLDER, PRESETS_FOLDER)
"""Folders with files that need the scene and the skills."""


@dataclass(frozen=True, kw_only=True)
class Checked:
    """Result of a check.

    Attributes:
        problems: Errors and warnings, file by file in the order of reading.
        agents: Agents without errors.
        files: Number of checked files.
        unchecked: Files that could not be checked, because the scene or the skills are broken.
    """

    problems: tuple[Diagnostic, ...]
    agents: tuple[str, ...]
    files: int
    unchecked: tuple[str, ...] = ()


def check_folder(
    folder: Path, interfaces: Interfaces | None = None, only: Collection[Path] | None = None
) -> Checked:
    """Return the problems of a trees folder.

    Args:
        folder: Holds ``scene.yaml``, ``market.yaml``, ``skills``, ``libraries``, ``agents``,
            ``scripts``, ``texts``, ``presets`` and, in ``scenes``, scene files of other robots.
        interfaces: The installed ROS types; None leaves types and fields unchecked.
        only: Files or folders that the result is limited to; broken scenes and skills are always
            reported, because everything needs them.
    """
    return _FolderCheck(folder, interfaces, only).run()


class _FolderCheck:
    """Check of one folder."""

    def __init__(
        self, folder: Path, interfaces: Interfaces | None, only: Collection[Path] | None
    ) -> None:
        self._folder = folder
        self._interfaces = interfaces
        self._only = None if only is None else [_real(path) for path in only]
        # In the order of reading; the same problem may be found in several ways.
        self._found: dict[Diagnostic, None] = {}
        self._presets: dict[str, Path] = {}

    def run(self) -> Checked:
        """Check everything."""
        folder = self._folder
        scene = folder / "scene.yaml"
        base = [scene, *yaml_files(folder / "skills")]
        others = yaml_files(folder / "scenes")
        dependent = [path for name in _DEPENDENT for path in yaml_files(folder / name, tests=True)]
        if (folder / MARKET_FILE).exists():
            dependent.insert(0, folder / MARKET_FILE)
        agents: list[AgentSpec] = []
        try:
            trees = read_trees(folder, self._interfaces)
        except ReadError:
            self._base_problems(scene, base[1:])
            unchecked = [path for path in dependent if self._is_wanted(path)]
            plugin_problems = installed_plugins().problems
        else:
            unchecked = []
            plugin_problems = trees.plugin_problems
            agents = self._dependent_problems(trees, dependent)
        self._add_other_scenes(others)
        wanted = [path for path in (*base, *others, *dependent) if self._is_wanted(path)]
        for path in wanted:
            source = _source(str(path))
            if source is not None:
                with self._guarded(path):
                    self._add(cut_texts(source))
        self._add(_bad_plugin(folder, words) for words in plugin_problems)
        for name in ("skills", "scenes", *_DEPENDENT):
            unread = _passed_over(folder / name)
            self._add(one for one in unread if self._is_wanted(Path(one.position.file)))
        return Checked(
            problems=tuple(_with_excerpts(_by_file(merged(self._found)))),
            agents=tuple(agent.name for agent in agents),
            files=len(wanted) - len(unchecked),
            unchecked=tuple(map(str, unchecked)),
        )

    def _is_wanted(self, path: Path) -> bool:
        if self._only is None:
            return True
        real = _real(path)
        return any(real == one or real.is_relative_to(one) for one in self._only)

    def _add(self, problems: Iterable[Diagnostic]) -> None:
        self._found |= dict.fromkeys(problems)

    @contextmanager
    def _guarded(self, file: Path | str) -> Iterator[None]:
        """Make an error in the block a problem of this file alone, also a fault of the check."""
        try:
            yield
        except ReadError as error:
            self._add(error.diagnostics)
        except BtAgentsError:
            raise
        except Exception as fault:
            problem = Diagnostic(
                code="reader-fault",
                position=Position(file=str(file), line=1, column=1),
                message=f"bt-agents cannot check this: {type(fault).__name__}: {fault}",
                hint="write it differently, and please report this file as a fault of bt-agents",
            )
            self._add([problem])

    def _base_problems(self, scene: Path, skills: list[Path]) -> None:
        with self._guarded(scene):
            read_scene(scene, self._interfaces)
        with self._guarded(self._folder / "skills"):
            read_skills(skills, self._interfaces)

    def _add_other_scenes(self, paths: Iterable[Path]) -> None:
        """Add the problems of scene files of robots whose ROS packages may be absent here."""
        known = OfInstalledPackages(self._interfaces) if self._interfaces is not None else None
        for path in filter(self._is_wanted, paths):
            with self._guarded(path):
                read_scene(path, known)

    def _dependent_problems(self, trees: Trees, paths: list[Path]) -> list[AgentSpec]:
        """Add the problems of files that need the scene and the skills; return the good agents."""
        if self._is_wanted(self._folder / "scene.yaml"):
            self._add(trees.scene.warnings)
        agents = [agent for agent in trees.agents if self._is_wanted(Path(agent.file))]
        for broken in trees.broken:
            if self._is_wanted(broken.file):
                self._add(broken.error.diagnostics)
        for agent in agents:
            with self._guarded(agent.file):
                self._add(lint(agent, names_persons=trees.scene.names_persons))
        for path in filter(self._is_wanted, paths):
            with self._guarded(path):
                if path.parent.name == "libraries":
                    self._add_library(trees.symbols, path)
                elif path.name.endswith(TEST_SUFFIXES):
                    read_test(path, trees.agents, trees.symbols)
                elif path.name == MARKET_FILE:
                    self._add_market(trees, path)
                elif path.parent.name == "scripts":
                    read_script(path, trees.scene.space)
                elif path.parent.name == FOLDER:
                    read_texts(path)
                elif path.parent.name == PRESETS_FOLDER:
                    self._add_preset(trees, path)
        if self._only is None and not (trees.agents or trees.broken):
            no_agents = Diagnostic(
                code="no-agents",
                position=Position(file=str(self._folder / "agents"), line=1, column=1),
                message="there is no agent in this folder",
                hint="make one with 'bt-agents new NAME'",
            )
            self._add([no_agents])
        self._add_texts(trees)
        return agents

    def _add_texts(self, trees: Trees) -> None:
        """Add problems of the texts of all languages, including unused ones."""
        read = {trees.language: trees}
        for language in FolderTexts(self._folder, "").languages():
            if language not in read:
                read[language] = read_trees(self._folder, self._interfaces, language=language)
        files: dict[Path, TextFile] = {}
        for other in read.values():
            for broken in other.broken:
                # Problems in an agent's own file are reported once, in the language of the folder.
                inserted = [
                    one
                    for one in broken.error.diagnostics
                    if Path(one.position.file).parent.name == FOLDER
                ]
                self._add(one for one in inserted if self._is_wanted(Path(one.position.file)))
        for language in read:
            texts = FolderTexts(self._folder, language)
            if language and texts.path.exists() and texts.broken is None:
                files[texts.path] = read_texts(texts.path)
        used = None
        if not any(one.broken for one in read.values()):
            used = {name for one in read.values() for name in one.inserted}
        self._add(
            one for one in uneven_texts(files, used) if self._is_wanted(Path(one.position.file))
        )

    def _add_market(self, trees: Trees, path: Path) -> None:
        rules = read_market(path, trees.scene.space)
        self._add(one for rule in rules for one in rule.warnings)
        if not trees.broken:
            self._add(unknown_agents(rules, [agent.name for agent in trees.agents]))

    def _add_preset(self, trees: Trees, path: Path) -> None:
        preset = read_preset(path, trees.agents, self._presets)
        self._presets[preset.name] = path
        if not trees.broken:
            self._add(unknown_values(preset, trees.agents))

    def _add_library(self, symbols: SymbolTable, path: Path) -> None:
        if symbols.libraries is not None:
            # An unreadable library is among the broken files.
            with suppress(ImportProblem):
                library = symbols.libraries.load(f"{path.parent.name}/{path.name}")
                self._add([*unused_inputs(library.unused_inputs), *library.warnings])


def _real(path: Path) -> Path:
    """Return the target of a path; a link that leads back to itself is its own target."""
    try:
        return path.resolve()
    except RuntimeError:
        return path.parent.resolve() / path.name


def _passed_over(folder: Path) -> Iterator[Diagnostic]:
    """Yield a warning for each YAML file that is too deep, or whose suffix has capitals."""
    for path in sorted([*folder.glob("[!.]*"), *folder.glob("[!.]*/[!.]*")]):
        is_read = path.parent == folder and path.suffix in SUFFIXES
        if path.suffix.lower() in SUFFIXES and not is_read and path.is_file():
            yield warning(
                "passed-over",
                Position(file=str(path), line=1, column=1),
                1,
                "bt-agents does not read this file",
                "files are directly in a folder such as agents, and end in .yaml or .yml",
            )


def _bad_plugin(folder: Path, words: str) -> Diagnostic:
    return warning(
        "bad-plugin",
        Position(file=str(folder), line=1, column=1),
        1,
        words,
        "trees cannot use this node; fix its package, or remove it",
    )


def _by_file(problems: Collection[Diagnostic]) -> list[Diagnostic]:
    """Return problems file by file, in the order of each file."""
    files = dict.fromkeys(problem.position.file for problem in problems)
    order = {file: number for number, file in enumerate(files)}

    def place(problem: Diagnostic) -> tuple[int, int, int]:
        file, line, column = problem.position
        return order[file], line, column

    return sorted(problems, key=place)


def _with_excerpts(problems: Collection[Diagnostic]) -> Iterator[Diagnostic]:
    """Yield problems with their lines, also those found in checked trees."""
    files = {problem.position.file for problem in problems if not problem.excerpt}
    sources = {file: _source(file) for file in files}
    for problem in problems:
        source = sources.get(problem.position.file)
        if problem.excerpt or source is None:
            yield problem
        else:
            yield replace(problem, excerpt=source.line(problem.position.line))


def _source(file: str) -> Source | None:
    try:
        return read_source(Path(file))
    except ReadError:
        return None
