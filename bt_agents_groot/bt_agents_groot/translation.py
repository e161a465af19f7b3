# SPDX-License-Identifier: Apache-2.0
"""Translation of a tree: its interface for the translators of elements, and its remarks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from bt_agents_core.diagnostic import Position
from bt_agents_groot.formulas import Formula
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.scripts import Statement
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode


class RemarkLevel(Enum):
    """Severity of a remark; the value is its prefix in texts."""

    LOST = "not translated"
    NOTE = "note"


@dataclass(frozen=True, kw_only=True)
class Remark:
    """Difference or loss at a place of the file that was translated."""

    level: RemarkLevel
    position: Position
    message: str

    def __str__(self) -> str:
        return f"{self.position}: {self.level.value}: {self.message}"

    @property
    def comment(self) -> str:
        """Text of the remark for a comment in the translated file."""
        return f"{self.level.value}: {self.message}"


class Remarks:
    """Collection of remarks; the same one at the same place counts once."""

    def __init__(self) -> None:
        self._remarks: dict[Remark, None] = {}

    def __iter__(self) -> Iterator[Remark]:
        return iter(sorted(self._remarks, key=lambda r: (r.position.line, r.position.column)))

    def add(self, level: RemarkLevel, position: Position, message: str) -> Remark:
        """Add a remark and return it."""
        remark = Remark(level=level, position=position, message=message)
        self._remarks.setdefault(remark)
        return remark


class Translation(Protocol):
    """Tree that is being imported.

    Attributes:
        names: Its name scope.
    """

    names: TreeNames

    def node(self, element: Element, *, below_fallback: bool = False) -> YamlNode:
        """Return the node for an element and all below it."""

    def decorate(self, element: Element, node: YamlNode, key: str, value: Data) -> YamlNode:
        """Return a node with a decorator around it; remark on differences when it is skipped."""

    def remark(self, level: RemarkLevel, where: Element | Attribute, message: str) -> None:
        """Add a remark, which also becomes a comment above the node being translated."""

    def statements(self, attribute: Attribute) -> list[Statement]:
        """Return the statements of a script.

        Raises:
            Untranslatable: They stand in a blackboard entry.
        """

    def condition(self, attribute: Attribute) -> Formula:
        """Return a script as a condition.

        Raises:
            Untranslatable: It is none.
        """

    def text(self, condition: Formula) -> Raw:
        """Return a condition as text of our language; its names are recorded as read.

        Raises:
            Untranslatable: Our language has no such condition.
        """
