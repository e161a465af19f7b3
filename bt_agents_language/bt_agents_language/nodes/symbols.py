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
    """What a library file, as messages name it, offers to those that import it."""

    file: str
    skills: Mapping[str, SkillSpec] = field(default_factory=dict)
    subtrees: Mapping[str, SubtreeSpec] = field(default_factory=dict)
    unused_inputs: tuple[UnusedInput, ...] = ()
    warnings: tuple[Diagnostic, ...] = ()


class ImportProblem(BtAgentsError):
    """A library that cannot be imported, with the problem at the place of the import."""

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.hint = hint


class Libraries(Protocol):
    """Finds libraries by the paths that files import."""

    def load(self, path: str) -> Library:
        """Return the library of a path from the trees folder.

        Raises:
            ImportProblem: It cannot be imported.
        """

    def speaking(self, language: str) -> Libraries:
        """Return the libraries with the texts of another language."""

    def paths(self) -> list[str]:
        """Return the paths of all libraries that could be imported."""

    def with_subtree(self, name: str) -> list[str]:
        """Return the paths of the libraries that have a subtree of a name, as far as is known."""


@dataclass(frozen=True)
class SymbolTable:
    """The words that files with trees are checked against.

    Attributes:
        interfaces: The installed ROS types; None leaves types and fields unchecked.
        plugins: Node types that plug-ins bring, by key.
        libraries: Finds what ``imports`` names; None where there is no trees folder.
        texts: Finds the texts of ``${t.…}``; None where there is no trees folder.
        incomplete: True when an import has failed, whose words are not known therefore.
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
        """Every node type by key, those of plug-ins included."""
        return {**NODE_TYPES, **self.plugins}

    def speaking(self, language: str) -> SymbolTable:
        """Return the same with the texts of another language."""
        return replace(
            self,
            texts=self.texts.speaking(language) if self.texts is not None else None,
            libraries=self.libraries.speaking(language) if self.libraries is not None else None,
        )

    def with_skills(self, skills: Mapping[str, SkillSpec]) -> SymbolTable:
        """Return the same with more skills; nodes of plug-ins with such a name give way."""
        plugins = {key: kind for key, kind in self.plugins.items() if key not in skills}
        return replace(self, skills={**self.skills, **skills}, plugins=plugins)
