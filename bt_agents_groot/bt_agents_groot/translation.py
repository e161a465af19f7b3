# SPDX-License-Identifier: Apache-2.0
"""What the translators of single elements need of the translation of the whole tree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from bt_agents_groot.formulas import Formula
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.scripts import Statement
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode
from bt_agents_language.model.specs import Position


class RemarkLevel(Enum):
    """How much a remark matters; the value is the word before it."""

    LOST = "not translated"
    NOTE = "note"


@dataclass(frozen=True, kw_only=True)
class Remark:
    """One remark about a place in the file that was translated."""

    weight: RemarkLevel
    position: Position
    message: str

    def __str__(self) -> str:
        return f"{self.position}: {self.weight.value}: {self.message}"

    @property
    def comment(self) -> str:
        """The remark as it stands in the file that was made."""
        return f"{self.weight.value}: {self.message}"


class Remarks:
    """Collects remarks; the same one at the same place counts once."""

    def __init__(self) -> None:
        self._remarks: dict[Remark, None] = {}

    def __iter__(self) -> Iterator[Remark]:
        return iter(sorted(self._remarks, key=lambda r: (r.position.line, r.position.column)))

    def add(self, weight: RemarkLevel, position: Position, message: str) -> Remark:
        """Add a remark and return it."""
        remark = Remark(weight=weight, position=position, message=message)
        self._remarks.setdefault(remark)
        return remark


class Translation(Protocol):
    """One tree while it is translated.

    Attributes:
        names: Its names.
    """

    names: TreeNames

    def node(self, element: Element, *, below_fallback: bool = False) -> YamlNode:
        """Return the node for an element and all below it."""

    def around(self, element: Element, node: YamlNode, key: str, value: Data) -> YamlNode:
        """Return a node with a modifier around it; note what differs when the node is left out."""

    def remark(self, weight: RemarkLevel, where: Element | Attribute, message: str) -> None:
        """Add a remark, which also becomes a comment above the node being translated."""

    def statements(self, attribute: Attribute) -> list[Statement]:
        """Return the statements of a script.

        Raises:
            Untranslatable: They stand in a blackboard entry.
        """

    def condition(self, attribute: Attribute) -> Formula:
        """Return the condition that a script is.

        Raises:
            Untranslatable: It is none.
        """

    def text(self, condition: Formula) -> Raw:
        """Return a condition as it stands in a file, its names remembered.

        Raises:
            Untranslatable: Our language has no such condition.
        """
