# SPDX-License-Identifier: Apache-2.0
"""Agents from recorded texts, read on a machine that may have neither their folder nor ROS."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from bt_agents.host.reload.source_bundle import APART, HOST
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.field_types import BindingKind, FieldType, Plain
from bt_agents_core.scene import SceneSpace
from bt_agents_language.files.folder_reader import Trees, read_trees

SCENE = "scene.yaml"


class RecordedInterfaces:
    """ROS types of the machine on which the agents ran, as far as bindings depend on them.

    The bindings were in use, so they were valid; no value depends on the types of fields.
    """

    def __init__(self, packages: frozenset[str]) -> None:
        self._packages = packages

    def has_package(self, package: str) -> bool:
        return package in self._packages

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        return None

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        return None

    def field_type(self, kind: BindingKind, type_name: str, section: str, path: str) -> FieldType:
        return FieldType.ANY

    def value_problem(
        self, kind: BindingKind, type_name: str, section: str, values: Mapping[str, Plain]
    ) -> str | None:
        return None


@dataclass(frozen=True, kw_only=True)
class ParsedTexts:
    """Agents and scene parameters that the texts of a host define.

    Attributes:
        folder: Folder of the texts during reading, as positions state it.
    """

    trees: Trees
    folder: str

    @property
    def space(self) -> SceneSpace:
        """The scene parameters."""
        return self.trees.scene.space


@dataclass(frozen=True, kw_only=True)
class TextFiles:
    """Texts of a host at some time.

    Attributes:
        files: Path relative to the trees folder → text.
        versions: Name of an agent → its version.
    """

    files: Mapping[str, str]
    versions: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, message: Any) -> TextFiles:
        """Return the texts of an ``AgentFiles`` message.

        Raises:
            Refused: ``BAD_PATH``; a path leads outside the folder.
        """
        for path in message.files:
            parts = PurePosixPath(path)
            if parts.is_absolute() or ".." in parts.parts or not parts.parts or "\0" in path:
                raise Refused("BAD_PATH", f"the file '{path[:80]}' lies outside of the folder")
        return cls(
            files=dict(zip(message.files, message.texts, strict=True)),
            versions=dict(zip(message.agents, message.versions, strict=True)),
        )

    @cached_property
    def parsed(self) -> ParsedTexts:
        """Content of the texts, except for agents with their own texts.

        Raises:
            BtAgentsError: They cannot be read here.
        """
        return self._read(
            {name: text for name, text in self.files.items() if not name.startswith(f"{APART}/")}
        )

    def parsed_for(self, agent: str) -> ParsedTexts:
        """Return the content of the texts for one agent.

        Raises:
            BtAgentsError: They cannot be read here.
        """
        prefix = f"{APART}/{agent}/"
        own = {
            name.removeprefix(prefix): text
            for name, text in self.files.items()
            if name.startswith(prefix) or name in (HOST, SCENE)
        }
        return self._read(own) if len(own.keys() - {HOST, SCENE}) else self.parsed

    def _read(self, files: Mapping[str, str]) -> ParsedTexts:
        machine = json.loads(self.files.get(HOST, "{}"))
        interfaces = RecordedInterfaces(frozenset(map(str, machine.get("packages", ()))))
        with tempfile.TemporaryDirectory(prefix="bt-agents-replay-") as scratch:
            folder = Path(scratch) / "trees"
            for name, text in files.items():
                if name != HOST:
                    path = folder / name
                    path.parent.mkdir(parents=True, exist_ok=True)
                    path.write_bytes(text.encode())
            try:
                robot, language = (str(machine.get(key, "")) for key in ("robot", "language"))
                trees = read_trees(folder, interfaces, robot, language)
            except OSError as error:
                raise BtAgentsError(f"the texts cannot be unpacked: {error}") from None
        return ParsedTexts(trees=trees, folder=str(folder))
