# SPDX-License-Identifier: Apache-2.0
"""The nodes that an exported file declares, so that Groot2 knows their ports, and their IDs."""

from __future__ import annotations

from collections.abc import Iterable

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import BUILTINS, EXPLICIT
from bt_agents_groot.port_types import written_type
from bt_agents_groot.ports import plain_port
from bt_agents_groot.words import pascal, port
from bt_agents_groot.xml_writer import Xml
from bt_agents_language.model.specs import FieldSpec, SkillSpec, SubtreeSpec, Tunable
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES
from bt_agents_language.nodes.node_type import NodeField, NodeType


class Models:
    """Collects the nodes that a file uses and BehaviorTree.CPP does not bring along."""

    def __init__(self) -> None:
        self._ids: dict[tuple[str, str], str] = {}
        self._taken = {
            *BUILTINS, *EXPLICIT, *NODE_TYPES, *DECORATORS,
            "SubTree", "BehaviorTree", "TreeNodesModel", "Root", "root", "include",
        }  # fmt: skip
        self._models: dict[str, Xml] = {}

    def tree_id(self, name: str) -> str:
        """Return the ID of a tree of the agent itself."""
        return self._id("tree", name)

    def subtree(self, file: str, subtree: SubtreeSpec) -> str:
        """Return the ID of a subtree and declare it."""
        own = self._id(f"in {file}", subtree.name)
        ports = (*_ports("input_port", subtree.inputs), *_ports("output_port", subtree.outputs))
        self._declare("SubTree", own, ports)
        return own

    def main(self, own: str, tunables: Iterable[Tunable]) -> None:
        """Declare the main tree, whose ports are the agent's tunables."""
        ports = tuple(
            _declared(
                "input_port",
                one.name,
                one.type,
                one.description,
                plain_port(one.default, one.type),
            )
            for one in tunables
        )
        if ports:
            self._declare("SubTree", own, ports)

    def skill(self, skill: SkillSpec) -> str:
        """Return the ID of a skill and declare it."""
        own = self._id("leaf", skill.name)
        ports = (*_ports("input_port", skill.inputs), *_ports("output_port", skill.outputs))
        self._declare("Action", own, ports)
        return own

    def plugin(self, node_type: NodeType) -> str:
        """Return the ID of a plug-in's node and declare it."""
        own = self._id("leaf", node_type.key)
        self._declare("Action", own, tuple(map(_port, node_type.fields)))
        return own

    def word(self, kind: str, key: str, ports: Iterable[NodeField]) -> str:
        """Return the ID of a word of our language, which is the word, and declare it.

        Args:
            kind: ``Action``, ``Condition``, ``Control`` or ``Decorator``.
            key: The word.
            ports: Its fields.
        """
        self._declare(kind, key, tuple(map(_port, ports)))
        return key

    def xml(self) -> Xml:
        """Return the declarations."""
        return Xml(
            tag="TreeNodesModel", children=tuple(self._models[key] for key in sorted(self._models))
        )

    def _id(self, group: str, name: str) -> str:
        if (group, name) not in self._ids:
            own = pascal(name, self._taken)
            self._taken.add(own)
            self._ids[group, name] = own
        return self._ids[group, name]

    def _declare(self, kind: str, own: str, ports: tuple[Xml, ...]) -> None:
        self._models.setdefault(own, Xml(tag=kind, attributes={"ID": own}, children=ports))


def _ports(tag: str, fields: tuple[FieldSpec, ...]) -> tuple[Xml, ...]:
    return tuple(
        _declared(tag, one.name, one.type, one.description, _default(one)) for one in fields
    )


def _port(one: NodeField) -> Xml:
    return _declared("input_port", one.name, one.type, one.description, "")


def _declared(tag: str, name: str, of: FieldType, description: str, default: str) -> Xml:
    attributes = {"name": port(name)}
    if written_type(of):
        attributes["type"] = written_type(of)
    if default:
        attributes["default"] = default
    return Xml(tag=tag, attributes=attributes, text=description)


def _default(one: FieldSpec) -> str:
    return "" if one.required or one.default is None else plain_port(one.default, one.type)
