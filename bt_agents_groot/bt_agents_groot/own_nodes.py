# SPDX-License-Identifier: Apache-2.0
"""Import of custom nodes that are named as node keys of our language."""

from __future__ import annotations

from dataclasses import replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.document import given_ports, node_id
from bt_agents_groot.naming import port
from bt_agents_groot.ports import PortError, from_port, names_in, names_of_expression
from bt_agents_groot.tree_import import TreeImport
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, decorated
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES
from bt_agents_language.nodes.node_type import Children, Content, NodeType
from bt_agents_language.nodes.parallel import PARALLEL
from bt_agents_language.nodes.random import RANDOM


def own_leaf(tree: TreeImport, element: Element) -> YamlNode | None:
    """Return the node for an element named as a leaf of our language; None for any other."""
    own = NODE_TYPES.get(node_id(element))
    if own is None or own.children is not Children.NONE:
        return None
    if own.open:
        values = element.attributes.get("values")
        outputs = port_value(tree, values, FieldType.ANY) if values is not None else None
        fields = outputs if isinstance(outputs, dict) else None
    else:
        fields = _own_fields(tree, element, own)
        outputs = fields.get("outputs") if fields is not None else None
    if fields is None:
        return None
    for name in outputs if isinstance(outputs, dict) else ():
        tree.names.write(name)
    return YamlNode(key=own.key, value=_value(own, fields))


def own_decorator(tree: TreeImport, element: Element) -> YamlNode | None:
    """Return the node for a decorator of our language; None when it is none."""
    own = DECORATORS.get(node_id(element))
    if own is None or own.main is None or len(element.children) != 1:
        return None
    fields = _own_fields(tree, element, own)
    if fields is None:
        return None
    return decorated(tree.node(element.children[0]), own.key, _value(own, fields))


def own_control(tree: TreeImport, element: Element) -> YamlNode | None:
    """Return the node for our ``random``, or ``parallel`` with names; None for anything else."""
    ports = {attribute.name for attribute in given_ports(element)}
    if node_id(element) == PARALLEL.key and ports == {"succeed_on"}:
        wanted = from_port(element.get("succeed_on"), FieldType.ANY, tree.names.rename)
        children = tuple(map(tree.node, element.children))
        return YamlNode(key=PARALLEL.key, value={"succeed_on": wanted}, children=children)
    if node_id(element) != RANDOM.key or not ports <= {"seed", "weights"}:
        return None
    weights = from_port(element.get("weights", "json:[]"), FieldType.ANY, tree.names.rename)
    if not isinstance(weights, list) or len(weights) not in (0, len(element.children)):
        return None
    tree.names.read(names_in(weights), FieldType.NUMBER)
    chosen = [tree.node(child) for child in element.children]
    for number, weight in enumerate(weights):
        if weight != 1:
            written = Raw(weight) if isinstance(weight, str) else weight
            siblings = {**chosen[number].siblings, "weight": written}
            chosen[number] = replace(chosen[number], siblings=siblings)
    seed = element.get("seed")
    options: dict[str, Data] = {"seed": Raw(seed)} if seed else {}
    return YamlNode(key=RANDOM.key, value=options, children=tuple(chosen))


def _own_fields(tree: TreeImport, element: Element, own: NodeType) -> dict[str, Data] | None:
    """Return the fields of a node of our language; None when the ports are not those fields."""
    by_port = {port(one.name): one for one in own.fields}
    given = given_ports(element)
    required = {port(one.name) for one in own.fields if one.required}
    present = {attribute.name for attribute in given}
    if not present or not required <= present <= set(by_port):
        return None
    fields: dict[str, Data] = {}
    for attribute in given:
        one = by_port[attribute.name]
        if one.content is Content.CONDITION:
            tree.names.read(names_of_expression(attribute.value))
            fields[one.name] = Raw(attribute.value)
        else:
            fields[one.name] = port_value(tree, attribute, one.type)
    return fields


def _value(own: NodeType, fields: dict[str, Data]) -> Data:
    return fields[own.main] if own.main is not None and list(fields) == [own.main] else fields


def port_value(tree: TreeImport, attribute: Attribute, field_type: FieldType) -> Data:
    """Return the value of a port; the names in it are recorded as read."""
    try:
        data = from_port(attribute.value, field_type, tree.names.rename)
    except PortError as error:
        tree.lost(attribute, str(error))
        return attribute.value
    if isinstance(data, str) and "${" in data.replace("$${", ""):
        tree.note(attribute, "the ${…} in it is taken as a name of our language")
    tree.names.read(names_in(data), field_type)
    return data
