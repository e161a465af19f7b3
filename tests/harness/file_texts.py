# SPDX-License-Identifier: Apache-2.0
"""Readers of files, applied to texts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from bt_agents_language.fields.interfaces import Interfaces
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.files.testing.scenarios import AgentTest
from bt_agents_language.files.testing.test_reader import read_test
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_language.model.specs import AgentSpec, SkillSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.source import Source


def read_agent_text(text: str, file: str, symbols: SymbolTable) -> AgentSpec:
    return read_agent(Source(file, text), symbols)


def read_scene_text(text: str, file: str, interfaces: Interfaces | None = None) -> SceneSpec:
    return read_scene(Source(file, text), interfaces)


def read_skills_text(
    text: str, file: str, interfaces: Interfaces | None = None
) -> Mapping[str, SkillSpec]:
    return read_skills([Source(file, text)], interfaces)


def read_test_text(
    text: str, file: str, agents: Iterable[AgentSpec], symbols: SymbolTable
) -> AgentTest:
    return read_test(Source(file, text), agents, symbols)
