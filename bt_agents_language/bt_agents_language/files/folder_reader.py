# SPDX-License-Identifier: Apache-2.0
"""Reader of trees folders: scene, skills and all agents; a broken agent does not affect others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from bt_agents_core.diagnostic import Position
from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.text import join_words, quote
from bt_agents_language.diagnostics.collection import Diagnostics, did_you_mean, joined
from bt_agents_language.fields.interfaces import Interfaces
from bt_agents_language.files.agent_file import AgentFile, read_agent_file
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.files.texts_reader import FOLDER, FolderTexts
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_language.model.specs import AgentSpec, SkillSpec
from bt_agents_language.nodes.plugin_discovery import installed_plugins
from bt_agents_language.nodes.symbols import ImportProblem, SymbolTable
from bt_agents_language.yaml.source import Source, read_source

SUFFIXES = (".yaml", ".yml")
TEST_SUFFIXES = (".test.yaml", ".test.yml")
"""Suffixes of test files, which are next to their agents."""


@dataclass(frozen=True, kw_only=True)
class BrokenFile:
    """File that could not be read, with all of its problems."""

    file: Path
    error: ReadError


@dataclass(frozen=True, kw_only=True)
class Trees:
    """Trees folder.

    Attributes:
        symbols: Symbols that its agents may use.
        agents: The readable agents, by name.
        broken: The unreadable files of agents and libraries.
        plugin_problems: Why some nodes of installed packages are unusable, in words.
        problems: Problems of the folder as a whole, in words.
        robot: Robots whose bindings of skills are preferred; see :func:`read_skills`.
        tags: Only agents with one of these tags are wanted; empty for all.
        files: The agent files, as they were read.
        holders: Name of an agent → its file, which may be broken since.
        texts: Contents of the scene and of all files that agents share; None for unreadable ones.
        language: Language of the agents' texts; empty for none.
        inserted: Names of the texts that agents and libraries insert.
    """

    folder: Path
    scene: SceneSpec
    symbols: SymbolTable
    agents: tuple[AgentSpec, ...]
    broken: tuple[BrokenFile, ...]
    plugin_problems: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    robot: str = ""
    tags: tuple[str, ...] = ()
    files: tuple[AgentFile, ...] = ()
    holders: Mapping[str, Path] = field(default_factory=dict)
    texts: Mapping[Path, str | None] = field(default_factory=dict)
    language: str = ""
    inserted: frozenset[str] = frozenset()

    @property
    def report(self) -> str:
        """All problems of the broken files as text, without duplicates."""
        return joined(one.error for one in self.broken).report

    def tagged(self, tags: str) -> Trees:
        """Return the folder with only those agents that have one of the tags ``a, b``, if any.

        Raises:
            BtAgentsError: No agent has the tag.
        """
        wanted = tuple(tag.strip() for tag in tags.split(",") if tag.strip())
        known = sorted({tag for agent in self.agents for tag in agent.tags})
        for tag in wanted:
            if tag not in known:
                raise BtAgentsError(
                    f"no agent has the tag '{tag}'; there are {', '.join(known) or 'none'}"
                )
        chosen = tuple(agent for agent in self.agents if is_wanted(agent, wanted))
        return replace(self, agents=chosen, tags=wanted)


def binding_problems(skills: Mapping[str, SkillSpec], robot: str) -> Iterator[str]:
    """Yield messages about robots that are preferred without effect; see :func:`read_skills`."""
    every = sorted({name for skill in skills.values() for name in skill.robots})
    wanted = [name for one in robot.split(",") if (name := one.strip())]
    for name in wanted:
        if name not in every:
            hint = did_you_mean(name, every) or "there are no bindings"
            yield f"no skills file binds the robot {quote(name)}, which is preferred; {hint}"
    for skill in skills.values():
        for name in wanted:
            problem = skill.robots.get(name)
            if problem == "":
                break
            if problem is not None:
                yield f"skill '{skill.name}' is not done by {quote(name)}, as preferred: {problem}"


def read_trees(
    folder: Path, interfaces: Interfaces | None = None, robot: str = "", language: str = ""
) -> Trees:
    """Return everything in a trees folder.

    Args:
        folder: Holds ``scene.yaml``, ``skills/*.yaml``, ``libraries/*.yaml``, ``texts/*.yaml`` and
            ``agents/*.yaml``.
        interfaces: The installed ROS types; None leaves types and fields unchecked.
        robot: Robots whose bindings of skills are preferred; see :func:`read_skills`.
        language: Language of the texts; empty takes the language of ``scene.yaml``.

    Raises:
        ReadError: ``scene.yaml`` or a skills file is broken, so that no agent can be read.
        BtAgentsError: There are no texts in the requested language.
    """
    shared = [
        folder / "scene.yaml",
        *yaml_files(folder / "skills"),
        *yaml_files(folder / "libraries"),
        *yaml_files(folder / FOLDER),
    ]
    # Take these texts before reading: a later change then differs from them at the next check.
    texts = {path: text_of(path) for path in shared}
    scene = read_scene(folder / "scene.yaml", interfaces)
    texts_of_language = FolderTexts(folder, language or scene.language)
    known = texts_of_language.languages()
    if language not in ("", scene.language, *known):
        there = f"some in {join_words(known, 'and')}" if known else "none"
        raise BtAgentsError(
            f"there are no texts in the language {quote(language)} in '{folder}'; "
            f"there are {there}"
        )
    libraries = _libraries(folder, scene, interfaces, robot, texts_of_language)
    files = [read_agent_file(path, libraries) for path in yaml_files(folder / "agents")]
    agents, files, holders = named(files, {})
    broken = broken_files(files, folder, libraries)
    return Trees(
        folder=folder,
        scene=scene,
        symbols=libraries.symbols,
        agents=agents,
        broken=broken,
        plugin_problems=plugin_problems(libraries),
        robot=robot,
        files=tuple(files),
        holders=holders,
        texts=texts,
        language=texts_of_language.language,
        inserted=frozenset(texts_of_language.found),
    )


def read_symbols(folder: Path) -> SymbolTable:
    """Return the symbols for agents of a folder, without ROS types, like :func:`read_trees`."""
    scene = read_scene(folder / "scene.yaml")
    return _libraries(folder, scene, None, "", FolderTexts(folder, scene.language)).symbols


def _libraries(
    folder: Path, scene: SceneSpec, interfaces: Interfaces | None, robot: str, texts: FolderTexts
) -> FolderLibraries:
    skills = read_skills(yaml_files(folder / "skills"), interfaces, robot)
    symbols = SymbolTable(
        space=scene.space,
        skills=skills,
        interfaces=interfaces,
        plugins=installed_plugins().without(skills).kinds,
    )
    return FolderLibraries(folder, symbols, robot, texts)


def yaml_files(folder: Path, *, tests: bool = False) -> list[Path]:
    """Return the YAML files of a folder by name, without hidden ones; with tests on request."""
    if not folder.is_dir():
        return []
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix in SUFFIXES and not path.name.startswith(".")
        if tests or not path.name.endswith(TEST_SUFFIXES)
    )


def is_wanted(agent: AgentSpec, tags: tuple[str, ...]) -> bool:
    """Return whether an agent has one of some tags, or no tags are named."""
    return not tags or not {*tags}.isdisjoint(agent.tags)


def text_of(path: Path) -> str | None:
    """Return the text of a file; None if it cannot be opened."""
    try:
        return read_source(path).text
    except ReadError:
        return None


def named(
    files: list[AgentFile], before: Mapping[str, Path]
) -> tuple[tuple[AgentSpec, ...], list[AgentFile], dict[str, Path]]:
    """Assign each name to one file; the previous holder keeps it, even while it is broken.

    Returns:
        The agents by name; the files, where later ones with a taken name are broken; the holders.
    """
    unreadable = {one.file for one in files if one.agent is None}
    holders = {name: file for name, file in before.items() if file in unreadable}
    agents: dict[str, AgentSpec] = {}
    late: dict[Path, ReadError] = {}

    def turn(one: AgentFile) -> tuple[bool, Path]:
        had = one.agent is not None and before.get(one.agent.name) == one.file
        return not had, one.file

    for one in sorted(files, key=turn):
        if one.agent is None:
            continue
        name = one.agent.name
        if name in holders:
            late[one.file] = _duplicate(one, one.agent, holders[name])
        else:
            holders[name] = one.file
            agents[name] = one.agent
    kept = [
        replace(one, agent=None, error=late[one.file]) if one.file in late else one
        for one in files
    ]
    return tuple(agents[name] for name in sorted(agents)), kept, holders


def broken_files(
    files: list[AgentFile], folder: Path, libraries: FolderLibraries
) -> tuple[BrokenFile, ...]:
    """Return the broken files of agents, and all broken libraries."""
    for path in libraries.paths():
        with suppress(ImportProblem):
            libraries.load(path)
    return (
        *(BrokenFile(file=one.file, error=one.error) for one in files if one.error is not None),
        *(BrokenFile(file=folder / name, error=e) for name, e in libraries.broken.items()),
        *(
            BrokenFile(file=one.path, error=one.broken)
            for one in libraries.texts.spoken
            if one.broken is not None
        ),
    )


def plugin_problems(libraries: FolderLibraries) -> tuple[str, ...]:
    """Return why nodes of packages are left out, also those named like a skill of a library."""
    skills = dict(libraries.symbols.skills)
    for name in libraries.paths():
        with suppress(ImportProblem):
            skills |= libraries.load(name).skills
    return installed_plugins().without(skills).problems


def _duplicate(late: AgentFile, agent: AgentSpec, first: Path) -> ReadError:
    source = Source(agent.file, late.text or "")
    lines = enumerate(source.text.splitlines(), start=1)
    line = next((number for number, text in lines if text.startswith("agent:")), 1)
    problems = Diagnostics(source)
    problems.add(
        "duplicate-agent",
        Position(file=source.file, line=line, column=1),
        f"there is an agent '{agent.name}' already: {first}",
        "give one of them another name",
    )
    return problems.error()
