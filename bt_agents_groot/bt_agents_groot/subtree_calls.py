# SPDX-License-Identifier: Apache-2.0
"""Import of ``SubTree`` elements with their arguments and outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bt_agents_core.field_types import FieldType
from bt_agents_groot.document import Model, ModelPort, given_ports
from bt_agents_groot.naming import entry_of, port, snake
from bt_agents_groot.ports import field_type_of, pointed_at
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.tree_import import TreeImport
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode
from bt_agents_language.fields.scope import KINDS


@dataclass(frozen=True, kw_only=True)
class Callee:
    """Tree that was imported as a subtree.

    Attributes:
        model: Declared ports, with their defaults.
        inputs: Declared input → its name inside the tree.
        outputs: Names that the tree writes and a caller uses.
        can_be_skipped: Whether the whole tree can be left out.
    """

    name: str
    names: TreeNames
    model: Model
    inputs: Mapping[str, str]
    outputs: tuple[str, ...]
    can_be_skipped: bool


def declared_port(model: Model, names: TreeNames, name: str) -> ModelPort:
    """Return the port that a tree declares for a name of ours; one without a type for none."""
    return model.ports.get(port(names.original(name)), ModelPort(direction=""))


def stated_type(declared: ModelPort, names: TreeNames, name: str) -> FieldType:
    """Return the declared type of a port; any if its tree uses the name as something else."""
    field_type = field_type_of(declared.type)
    used = names.type_of(name)
    # A text can be made of any value, and a literal number can be one.
    literal = field_type is FieldType.TEXT and name not in names.needed
    if literal or used in (FieldType.ANY, FieldType.TEXT) or KINDS[used] is KINDS.get(field_type):
        return field_type
    return FieldType.ANY


def type_of_port(declared: ModelPort, names: TreeNames, name: str) -> FieldType:
    """Return the declared type of a port, else the type that its tree uses the name as."""
    field_type = stated_type(declared, names, name)
    return field_type if field_type is not FieldType.ANY else names.type_of(name)


def ports_of_call(element: Element, model: Model) -> dict[str, str]:
    """Return the arguments of a ``SubTree`` element: entry → text, with ``{=}`` resolved.

    They include ports that point at an entry by default.
    """
    texts = {one.name: one.value for one in given_ports(element)}
    if not remaps_all(element):
        usual = {name: one.default for name, one in model.ports.items() if not one.value}
        texts = {name: text for name, text in usual.items() if text} | texts
    return {
        entry_of(name): f"{{{name}}}" if text == "{=}" else text for name, text in texts.items()
    }


def remaps_all(element: Element) -> bool:
    """Return whether a ``SubTree`` element shares all entries with the same name."""
    return element.get("_autoremap").strip().lower() in ("true", "1")


def subtree_call(tree: TreeImport, element: Element, callees: Mapping[str, Callee]) -> YamlNode:
    """Return the node that calls one of the already imported subtrees, given by ID."""
    tree_id = element.get("ID")
    callee = callees.get(tree_id)
    if callee is None:
        tree.lost(
            element,
            f"tree '{tree_id}' is in none of the named files; name its file, too, or declare "
            f"a skill '{snake(tree_id)}'",
        )
        return tree.skill(element)
    ports = ports_of_call(element, callee.model)
    entries = {callee.names.rename(entry): text for entry, text in ports.items()}
    arguments = _inputs(tree, element, callee, entries)
    outputs: dict[str, Data] = {}
    for name in callee.outputs:
        entry = pointed_at(entries.get(name, ""))
        if entry is None and name not in entries and remaps_all(element):
            entry = callee.names.original(name)
        if entry is not None:
            outputs[tree.names.rename(entry)] = name
            tree.names.write(tree.names.rename(entry))
    for name in entries:
        if name not in (*callee.inputs.values(), *callee.outputs):
            entry = callee.names.original(name)
            tree.note(element, f"'{entry}' is not passed on: '{callee.name}' does not need it")
    if callee.can_be_skipped:
        tree.note_skip(element, "the whole tree", "succeeded")
    siblings: dict[str, Data] = {"with": arguments, "outputs": outputs}
    given = {key: value for key, value in siblings.items() if value}
    return YamlNode(key="subtree", value=Raw(callee.name), siblings=given)


def _inputs(
    tree: TreeImport, element: Element, callee: Callee, entries: Mapping[str, str]
) -> dict[str, Data]:
    arguments: dict[str, Data] = {}
    for declared, inside in callee.inputs.items():
        text = entries.get(inside)
        if text is None and remaps_all(element):
            text = f"{{{callee.names.original(inside)}}}"
        known = declared_port(callee.model, callee.names, inside)
        if text is not None:
            field_type = type_of_port(known, callee.names, inside)
            arguments[declared] = tree.port(element, text, field_type)
        elif not known.value:
            tree.lost(
                element,
                f"nothing says what '{inside}' is for '{callee.name}'; write it under 'with'",
            )
            arguments[declared] = callee.names.default(inside)
    return arguments
