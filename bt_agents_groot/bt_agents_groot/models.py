# SPDX-License-Identifier: Apache-2.0
"""Models in an exported file: declarations of nodes with their ports and IDs, for Groot2."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from bt_agents_groot.catalogue import BUILTINS, EXPLICIT
from bt_agents_groot.naming import output_name, pascal, port
from bt_agents_groot.ports import cpp_type, plain_port
from bt_agents_groot.xml_files import Xml
from bt_agents_language.model.specs import FieldSpec, SubtreeSpec, Tunable
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES
from bt_agents_language.nodes.node_type import NodeField

Field = FieldSpec | NodeField | Tunable
"""Things that become ports."""


class Models:
    """Collection of the used nodes that are not built into BehaviorTree.CPP."""

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

    def subtree(self, file: str, subtree: SubtreeSpec, tunables: Iterable[Tunable] = ()) -> str:
        """Return the ID of a subtree and declare it, with the tunables that it uses."""
        model_id = self._id(f"in {file}", subtree.name)
        return self.declare("SubTree", model_id, [*subtree.inputs, *tunables], subtree.outputs)

    def leaf(self, name: str, inputs: Iterable[Field], outputs: Iterable[Field] = ()) -> str:
        """Return the ID of a skill or of a plug-in's node and declare it."""
        inputs = list(inputs)
        names = [one.name for one in inputs]
        renamed = [replace(one, name=output_name(one.name, names)) for one in outputs]
        return self.declare("Action", self._id("leaf", name), inputs, renamed)

    def declare(
        self, kind: str, model_id: str, inputs: Iterable[Field], outputs: Iterable[Field] = ()
    ) -> str:
        """Declare a node and return its ID, which for a node of our language is its key."""
        ports = [_port("input_port", one) for one in inputs]
        ports += [_port("output_port", one) for one in outputs]
        self._models.setdefault(model_id, Xml(kind, {"ID": model_id}, tuple(ports)))
        return model_id

    def xml(self) -> Xml:
        """Return the declarations."""
        return Xml(
            "TreeNodesModel", children=tuple(one for _, one in sorted(self._models.items()))
        )

    def _id(self, group: str, name: str) -> str:
        if (group, name) not in self._ids:
            model_id = pascal(name, self._taken)
            self._taken.add(model_id)
            self._ids[group, name] = model_id
        return self._ids[group, name]


def _port(tag: str, one: Field) -> Xml:
    attributes = {"name": port(one.name)}
    if cpp_type(one.type):
        attributes["type"] = cpp_type(one.type)
    optional = isinstance(one, Tunable) or (isinstance(one, FieldSpec) and not one.required)
    default = plain_port(one.default, one.type) if optional and one.default is not None else ""
    if default:
        attributes["default"] = default
    return Xml(tag, attributes, text=one.description)
