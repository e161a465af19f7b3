# SPDX-License-Identifier: Apache-2.0
"""Reads a trees folder: the scene, the skills and all agents; a broken agent stops no other."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from bt_agents.errors import BtAgentsError, ReadError
from bt_agents.language.agent_reader import read_agent
from bt_agents.language.diagnostics import Diagnostics
from bt_agents.language.interfaces import Interfaces
from bt_agents.language.libraries import FolderLibraries
from bt_agents.language.plugins import installed_plugins
from bt_agents.language.scene_reader import read_scene
from bt_agents.language.skills_reader import read_skills
from bt_agents.language.specs import AgentSpec, Position, SceneSpec
from bt_agents.language.text.source import read_source
from bt_agents.language.vocabulary import ImportProblem, Vocabulary

SUFFIXES = (".yaml", ".yml")
TEST_SUFFIXES = (".test.yaml", ".test.yml")
"""Ends of the names of files that test agents; they lie beside them."""


@dataclass(frozen=True, kw_only=True)
class BrokenFile:
    """An agent file that could not be read, and all that is wrong with it."""

    file: Path
    error: ReadError


@dataclass(frozen=True, kw_only=True)
class Trees:
    """A trees folder.

    Attributes:
        folder: Where it is.
        scene: ``scene.yaml``.
        vocabulary: What its agents may speak of.
        agents: The agents that could be read, by name.
        broken: The agent files that could not.
        plugin_problems: Why some nodes of installed packages cannot be used, in words.
    """

    folder: Path
    scene: SceneSpec
    vocabulary: Vocabulary
    agents: tuple[AgentSpec, ...]
    broken: tuple[BrokenFile, ...]
    plugin_problems: tuple[str, ...] = ()

    def tagged(self, tags: str) -> Trees:
        """Return the folder with those agents only that have one of some tags.

        Args:
            tags: Tags with commas between them; empty keeps every agent.

        Raises:
            BtAgentsError: No agent has a tag of this name.
        """
        wanted = [tag.strip() for tag in tags.split(",") if tag.strip()]
        known = sorted({tag for agent in self.agents for tag in agent.tags})
        for tag in wanted:
            if tag not in known:
                raise BtAgentsError(
                    f"no agent has the tag '{tag}'; there are {', '.join(known) or 'none'}"
                )
        kept = [agent for agent in self.agents if not wanted or set(wanted) & {*agent.tags}]
        return replace(self, agents=tuple(kept))


def read_trees(folder: Path, interfaces: Interfaces | None = None, robot: str = "") -> Trees:
    """Return everything in a trees folder.

    Args:
        folder: Holds ``scene.yaml``, ``skills/*.yaml``, ``libraries/*.yaml`` and
            ``agents/*.yaml``.
        interfaces: The installed ROS types; None leaves types and fields unchecked.
        robot: Robot whose bindings of skills are preferred; empty takes the first that fits.

    Raises:
        ReadError: ``scene.yaml`` or a skills file is broken, so that no agent can be read.
    """
    scene = read_scene(folder / "scene.yaml", interfaces)
    libraries = _libraries(folder, scene, interfaces, robot)
    vocabulary = libraries.vocabulary
    agents: dict[str, AgentSpec] = {}
    broken: list[BrokenFile] = []
    for path in yaml_files(folder / "agents"):
        try:
            agent = read_agent(path, vocabulary)
            if agent.name in agents:
                raise _duplicate(path, agent, agents[agent.name])
        except ReadError as error:
            broken.append(BrokenFile(file=path, error=error))
        else:
            agents[agent.name] = agent
    skills = dict(vocabulary.skills)
    for name in libraries.paths():
        with suppress(ImportProblem):
            skills |= libraries.load(name).skills
    broken += [
        BrokenFile(file=folder / name, error=error) for name, error in libraries.broken.items()
    ]
    return Trees(
        folder=folder,
        scene=scene,
        vocabulary=vocabulary,
        agents=tuple(agents[name] for name in sorted(agents)),
        broken=tuple(broken),
        plugin_problems=installed_plugins().without(skills).problems,
    )


def read_vocabulary(
    folder: Path, scene: SceneSpec, interfaces: Interfaces | None = None, robot: str = ""
) -> Vocabulary:
    """Return what the agents of a folder may speak of; as :func:`read_trees`.

    Raises:
        ReadError: A skills file is broken.
    """
    return _libraries(folder, scene, interfaces, robot).vocabulary


def _libraries(
    folder: Path, scene: SceneSpec, interfaces: Interfaces | None, robot: str
) -> FolderLibraries:
    skills = read_skills(yaml_files(folder / "skills"), interfaces, robot)
    vocabulary = Vocabulary(
        space=scene.space,
        skills=skills,
        interfaces=interfaces,
        plugins=installed_plugins().without(skills).kinds,
    )
    return FolderLibraries(folder, vocabulary, robot)


def yaml_files(folder: Path, *, tests: bool = False) -> list[Path]:
    """Return the YAML files of a folder by name, without hidden ones; with tests if asked for."""
    if not folder.is_dir():
        return []
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix in SUFFIXES
        and not path.name.startswith(".")
        and (tests or not path.name.endswith(TEST_SUFFIXES))
    )


def _duplicate(path: Path, agent: AgentSpec, first: AgentSpec) -> ReadError:
    source = read_source(path)
    lines = enumerate(source.text.splitlines(), start=1)
    line = next((number for number, text in lines if text.startswith("agent:")), 1)
    problems = Diagnostics(source)
    problems.add(
        "duplicate-agent",
        Position(file=source.file, line=line, column=1),
        f"there is an agent '{agent.name}' already: {first.file}",
        "give one of them another name",
    )
    return problems.error()
