# SPDX-License-Identifier: Apache-2.0
"""Symbol table of a file with trees: scene parameters, skills, plug-ins, libraries, ROS types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.scene import SceneSpace
from bt_agents_language.fields.interfaces import Interfaces
from bt_agents_language.fields.texts import Texts
from bt_agents_language.model.specs import SkillSpec, SubtreeSpec, UnusedInput
from bt_agents_language.nodes.catalogue import NODE_TYPES
from bt_agents_language.nodes.node_type import NodeType


@dataclass(frozen=True, kw_only=True)
class Library:
    """Content of a library file, as messages name it, for importing files."""

    file: str
    skills: Mapping[str, SkillSpec] = field(default_factory=dict)
    subtrees: Mapping[str, SubtreeSpec] = field(default_factory=dict)
    unused_inputs: tuple[UnusedInput, ...] = ()
    warnings: tuple[Diagnostic, ...] = ()


class ImportProblem(BtAgentsError):
    """Failed import of a library, with the problem at its place."""

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.hint = hint


class Libraries(Protocol):
    """Finder of libraries by the paths that files import."""

    def load(self, path: str) -> Library:
        """Return the library of a path from the trees folder.

        Raises:
            ImportProblem: The library cannot be imported.
        """

    def speaking(self, language: str) -> Libraries:
        """Return the libraries with the texts of another language."""

    def paths(self) -> list[str]:
        """Return the paths of all libraries that could be imported."""

    def with_subtree(self, name: str) -> list[str]:
        """Return the paths of the libraries that are known to have a subtree with a name."""


@dataclass(frozen=True)
class SymbolTable:
    """Words for checking files with trees.

    Attributes:
        interfaces: The installed ROS types; None leaves types and fields unchecked.
        plugins: Node types of plug-ins, by key.
        libraries: Finder of ``imports``; None without a trees folder.
        texts: Finder of the texts of ``${t.…}``; None without a trees folder.
        incomplete: True if an import has failed, so that its words are unknown.
    """

    space: SceneSpace
    skills: Mapping[str, SkillSpec]
    interfaces: Interfaces | None = None
    plugins: Mapping[str, NodeType] = field(default_factory=dict)
    libraries: Libraries | None = None
    texts: Texts | None = None
    incomplete: bool = False

    @cached_property
    def node_types(self) -> Mapping[str, NodeType]:
        """All node types by key, including plug-ins."""
        return {**NODE_TYPES, **self.plugins}

    def speaking(self, language: str) -> SymbolTable:
        """Return the same with the texts of another language."""
        return replace(
            self,
            texts=self.texts.speaking(language) if self.texts is not None else None,
            libraries=self.libraries.speaking(language) if self.libraries is not None else None,
        )

    def with_skills(self, skills: Mapping[str, SkillSpec]) -> SymbolTable:
        """Return the table with more skills, which replace plug-in nodes of the same names."""
        plugins = {key: kind for key, kind in self.plugins.items() if key not in skills}
        return replace(self, skills={**self.skills, **skills}, plugins=plugins)
