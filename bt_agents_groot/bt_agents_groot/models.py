# SPDX-License-Identifier: Apache-2.0
"""Models of an exported file: declarations of nodes with their ports and IDs, for Groot2."""

from __future__ import annotations

from collections.abc import Iterable

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import BUILTINS, EXPLICIT
from bt_agents_groot.naming import pascal, port
from bt_agents_groot.ports import cpp_type, plain_port
from bt_agents_groot.xml_files import Xml
from bt_agents_language.model.specs import FieldSpec, SkillSpec, SubtreeSpec, Tunable
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES
from bt_agents_language.nodes.node_type import NodeField, NodeType


class Models:
    """Collection of the nodes that a file uses and that are not built into BehaviorTree.CPP."""

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
        model_id = self._id(f"in {file}", subtree.name)
        ports = (*_ports("input_port", subtree.inputs), *_ports("output_port", subtree.outputs))
        self._declare("SubTree", model_id, ports)
        return model_id

    def main(self, model_id: str, tunables: Iterable[Tunable]) -> None:
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
            self._declare("SubTree", model_id, ports)

    def skill(self, skill: SkillSpec) -> str:
        """Return the ID of a skill and declare it."""
        model_id = self._id("leaf", skill.name)
        ports = (*_ports("input_port", skill.inputs), *_ports("output_port", skill.outputs))
        self._declare("Action", model_id, ports)
        return model_id

    def plugin(self, node_type: NodeType) -> str:
        """Return the ID of a plug-in's node and declare it."""
        model_id = self._id("leaf", node_type.key)
        self._declare("Action", model_id, tuple(map(_port, node_type.fields)))
        return model_id

    def node_key(self, kind: str, key: str, ports: Iterable[NodeField]) -> str:
        """Return the ID of a node key of our language, which is the key itself, and declare it.

        Args:
            kind: ``Action``, ``Condition``, ``Control`` or ``Decorator``.
            key: The node key.
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
            model_id = pascal(name, self._taken)
            self._taken.add(model_id)
            self._ids[group, name] = model_id
        return self._ids[group, name]

    def _declare(self, kind: str, model_id: str, ports: tuple[Xml, ...]) -> None:
        self._models.setdefault(
            model_id, Xml(tag=kind, attributes={"ID": model_id}, children=ports)
        )


def _ports(tag: str, fields: tuple[FieldSpec, ...]) -> tuple[Xml, ...]:
    return tuple(
        _declared(tag, one.name, one.type, one.description, _default(one)) for one in fields
    )


def _port(one: NodeField) -> Xml:
    return _declared("input_port", one.name, one.type, one.description, "")


def _declared(tag: str, name: str, of: FieldType, description: str, default: str) -> Xml:
    attributes = {"name": port(name)}
    if cpp_type(of):
        attributes["type"] = cpp_type(of)
    if default:
        attributes["default"] = default
    return Xml(tag=tag, attributes=attributes, text=description)


def _default(one: FieldSpec) -> str:
    return "" if one.required or one.default is None else plain_port(one.default, one.type)
