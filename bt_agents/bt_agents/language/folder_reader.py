# SPDX-License-Identifier: Apache-2.0
"""Reads a trees folder: the scene, the skills and all agents; a broken agent stops no other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bt_agents.errors import ReadError
from bt_agents.language.agent_reader import read_agent
from bt_agents.language.diagnostics import Diagnostics
from bt_agents.language.interfaces import Interfaces
from bt_agents.language.scene_reader import read_scene
from bt_agents.language.skills_reader import read_skills
from bt_agents.language.source import read_source
from bt_agents.language.specs import AgentSpec, Position, SceneSpec, SkillSpec
from bt_agents.language.vocabulary import Vocabulary

SUFFIXES = (".yaml", ".yml")


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
        skills: Skills of all files by name.
        agents: The agents that could be read, by name.
        broken: The agent files that could not.
    """

    folder: Path
    scene: SceneSpec
    skills: Mapping[str, SkillSpec]
    agents: tuple[AgentSpec, ...]
    broken: tuple[BrokenFile, ...]


def read_trees(folder: Path, interfaces: Interfaces | None = None) -> Trees:
    """Return everything in a trees folder.

    Args:
        folder: Holds ``scene.yaml``, ``skills/*.yaml`` and ``agents/*.yaml``.
        interfaces: The installed ROS types; None leaves types and fields unchecked.

    Raises:
        ReadError: ``scene.yaml`` or a skills file is broken, so that no agent can be read.
    """
    scene = read_scene(folder / "scene.yaml", interfaces)
    skills = read_skills(_files(folder / "skills"), interfaces)
    vocabulary = Vocabulary(space=scene.space, skills=skills, interfaces=interfaces)
    agents: dict[str, AgentSpec] = {}
    broken: list[BrokenFile] = []
    for path in _files(folder / "agents"):
        try:
            agent = read_agent(path, vocabulary)
            if agent.name in agents:
                raise _duplicate(path, agent, agents[agent.name])
        except ReadError as error:
            broken.append(BrokenFile(file=path, error=error))
        else:
            agents[agent.name] = agent
    return Trees(
        folder=folder,
        scene=scene,
        skills=skills,
        agents=tuple(agents[name] for name in sorted(agents)),
        broken=tuple(broken),
    )


def _files(folder: Path) -> list[Path]:
    """Return the YAML files of a folder in the order of their names; hidden ones are left out."""
    if not folder.is_dir():
        return []
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix in SUFFIXES and not path.name.startswith(".")
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
