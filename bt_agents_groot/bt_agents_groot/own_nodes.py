# SPDX-License-Identifier: Apache-2.0
"""Import of custom nodes that are named as node keys of our language."""

from __future__ import annotations

from collections.abc import Callable

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import CONDITIONS, OTHER_ATTRIBUTES
from bt_agents_groot.document import node_id
from bt_agents_groot.naming import port
from bt_agents_groot.ports import PortError, from_port, names_in, names_of_expression
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.translation import RemarkLevel
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode
from bt_agents_language.nodes.catalogue import NODE_TYPES
from bt_agents_language.nodes.node_type import Children, Content, NodeField
from bt_agents_language.nodes.set import SET

RemarkFunction = Callable[[RemarkLevel, Element | Attribute, str], None]
"""Function that adds a remark about an element or attribute."""


def own_leaf(element: Element, names: TreeNames, remark: RemarkFunction) -> YamlNode | None:
    """Return the node for an element named as a leaf of our language; None for any other."""
    own = NODE_TYPES.get(node_id(element))
    if own is None or own.children is not Children.NONE:
        return None
    if own.open:
        return _own_set(element, names, remark)
    fields = own_fields(element, own.fields, names, remark)
    if fields is None:
        return None
    outputs = fields.get("outputs")
    for name in outputs if isinstance(outputs, dict) else ():
        names.write(name)
    only_main = own.main is not None and list(fields) == [own.main]
    return YamlNode(key=own.key, value=fields[own.main or ""] if only_main else fields)


def _own_set(element: Element, names: TreeNames, remark: RemarkFunction) -> YamlNode | None:
    values = element.attributes.get("values")
    data = port_value(values, FieldType.ANY, names, remark) if values is not None else None
    if not isinstance(data, dict):
        return None
    for key in data:
        names.write(key)
    return YamlNode(key=SET.key, value=data)


def own_fields(
    element: Element, fields: tuple[NodeField, ...], names: TreeNames, remark: RemarkFunction
) -> dict[str, Data] | None:
    """Return the fields of a node of our language; None when the ports are not those fields."""
    by_port = {port(one.name): one for one in fields}
    written = given_ports(element)
    required = {port(one.name) for one in fields if one.required}
    present = {attribute.name for attribute in written}
    if not present or not required <= present <= set(by_port):
        return None
    result: dict[str, Data] = {}
    for attribute in written:
        one = by_port[attribute.name]
        if one.content is Content.CONDITION:
            names.read(names_of_expression(attribute.value))
            result[one.name] = Raw(attribute.value)
        else:
            result[one.name] = port_value(attribute, one.type, names, remark)
    return result


def port_value(
    attribute: Attribute, field_type: FieldType, names: TreeNames, remark: RemarkFunction
) -> Data:
    """Return the value of a port; the names in it are recorded as read."""
    try:
        data = from_port(attribute.value, field_type, names.rename)
    except PortError as error:
        remark(RemarkLevel.LOST, attribute, str(error))
        return attribute.value
    if isinstance(data, str) and "${" in data.replace("$${", ""):
        remark(RemarkLevel.NOTE, attribute, "the ${…} in it is taken as a name of our language")
    names.read(names_in(data), field_type)
    return data


def given_ports(element: Element) -> list[Attribute]:
    """Return the attributes of an element that are ports."""
    return [
        attribute
        for attribute in element.attributes.values()
        if attribute.name not in (*CONDITIONS, *OTHER_ATTRIBUTES)
        and not attribute.name.startswith("_")
    ]
