# SPDX-License-Identifier: Apache-2.0
"""What the translators of single elements need of the translation of the whole tree."""

from __future__ import annotations

from typing import Protocol

from bt_agents_groot.formulas import Formula
from bt_agents_groot.remarks import RemarkLevel
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.scripts import Statement
from bt_agents_groot.written import Data, Raw, YamlNode
from bt_agents_groot.xml_reader import Attribute, Element


class Translation(Protocol):
    """One tree while it is translated.

    Attributes:
        names: Its names.
    """

    names: TreeNames

    def node(self, element: Element, *, below_fallback: bool = False) -> YamlNode:
        """Return the node for an element and all below it."""

    def around(self, element: Element, node: YamlNode, key: str, value: Data) -> YamlNode:
        """Wrap a node in a decorator, and remark what differs when the node is left out."""

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
