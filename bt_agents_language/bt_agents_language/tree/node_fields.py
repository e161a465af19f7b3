# SPDX-License-Identifier: Apache-2.0
"""Fields of a node, read according to its node type."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import nearest
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.fields.bindings import read_output
from bt_agents_language.fields.interfaces import MessageFields, read_ros_name, read_ros_type
from bt_agents_language.fields.scene_values import read_parameter
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.values import EXPECTED, read_condition, read_value
from bt_agents_language.model.specs import Literal, MapValue, Value
from bt_agents_language.nodes.catalogue import SIBLING_KEYS
from bt_agents_language.nodes.node_type import Content, FieldValues, NodeField
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.typed_reader import TypedReader, found
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import Node, Scalar


class FieldReader:
    """Reader of fields of nodes and decorators."""

    def __init__(self, reading: TypedReader, symbols: SymbolTable) -> None:
        self._reading = reading
        self._profiles = symbols.space.profiles
        self._interfaces = symbols.interfaces

    def read_all(
        self,
        fields: tuple[NodeField, ...],
        nodes: Mapping[str, Node],
        names: NameScope,
        main: str | None = None,
        what: str = "",
    ) -> FieldValues:
        """Return the values of fields by name; missing ones have their defaults.

        Messages call the field ``main`` ``what``, and all others by their names.
        """
        values: FieldValues = {}
        for field in fields:
            node = nodes.get(field.name)
            if node is None:
                if field.default_value is not None:
                    values[field.name] = field.default_value
                continue
            label = what if field.name == main else f"'{field.name}'"
            value = self.read(field, node, names, label, nodes)
            if value is not None:
                values[field.name] = value
        return values

    def read(
        self,
        field: NodeField,
        node: Node,
        names: NameScope,
        what: str,
        siblings: Mapping[str, Node],
    ) -> Value | Expression | None:
        """Return the value of one field, or report that it is wrong and return None."""
        reading = self._reading
        match field.content:
            case Content.VALUE:
                if field.words and isinstance(node, Scalar):
                    if node.text in field.words:
                        return Literal(value=node.text)
                    meant = nearest(node.text, field.words)
                    if meant is not None:
                        message = f"{what}: expected {EXPECTED[field.type]}, found "
                        message += quote(node.text)
                        reading.error("bad-number", node, message, f"did you mean '{meant}'?")
                        return None
                return read_value(reading, node, field.type, names, what, field.minimum)
            case Content.CONDITION:
                if field.message:
                    names = names.and_message(field.message, self._message(siblings))
                return read_condition(reading, node, names, what)
            case Content.ROS_NAME:
                return _literal(read_ros_name(reading, node, what))
            case Content.ROS_TYPE:
                return _literal(read_ros_type(reading, node, BindingKind.TOPIC, self._interfaces))
            case Content.MAP:
                return self._scene_values(node, names, what)
            case Content.CONSTANT:
                return self._constant(field, node, what)
        # The rest are nodes, outputs and counts, which have their own readers.
        return None

    def outputs(self, node: Node | None, siblings: Mapping[str, Node]) -> dict[str, str]:
        """Return the fields of a message that are assigned to names."""
        if node is None:
            return {}
        message = self._message(siblings)
        outputs: dict[str, str] = {}
        for entry in self._reading.entries(node, "'outputs'", "names and fields"):
            what = f"output '{entry.key.text[:40]}'"
            path = read_output(self._reading, entry.value, what, message, "msg")
            if path is not None:
                outputs[entry.key.text] = path
        return outputs

    def _constant(self, field: NodeField, node: Node, what: str) -> Literal | None:
        if field.words:
            return _literal(self._reading.choice(node, what, field.words))
        if field.type is FieldType.BOOLEAN:
            return _literal(self._reading.boolean(node, what))
        if field.type in (FieldType.TEXT, FieldType.ANY):
            return _literal(self._reading.text(node, what))
        return _literal(self._reading.amount(node, what, field.type, field.minimum))

    def _scene_values(self, node: Node, names: NameScope, what: str) -> MapValue:
        values: dict[str, Value] = {}
        for entry in self._reading.entries(node, what, "scene parameters and values"):
            one = read_parameter(self._reading, entry.key, self._profiles)
            if one is None:
                continue
            name = one.name
            value = read_value(self._reading, entry.value, FieldType.NUMBER, names, f"'{name}'")
            if value is None:
                continue
            values[name] = value
            if isinstance(value, Literal) and isinstance(value.value, int | float):
                self._reading.in_range(entry.value, name, value.value, one.minimum, one.maximum)
        return MapValue(items=values)

    def _message(self, siblings: Mapping[str, Node]) -> MessageFields:
        node = siblings.get("type")
        type_name = node.text if isinstance(node, Scalar) else ""
        return MessageFields(self._interfaces, BindingKind.TOPIC, type_name, "message")


def written_fields(
    reading: TypedReader, node: Node, what: str, fields: tuple[NodeField, ...], main: str | None
) -> Mapping[str, Node] | None:
    """Return the written fields of a node or decorator; a scalar is its main field.

    If they are unreadable, report that and return None.
    """
    if main is not None and isinstance(node, Scalar) and not node.empty:
        return {main: node}
    required = [field.name for field in fields if field.required]
    if isinstance(node, Scalar) and node.empty and not required:
        return {}
    if not fields and not isinstance(node, MappingNode):
        reading.error(
            "wrong-type", node, f"{what} has no fields, found {found(node)}", "remove it"
        )
        return None
    if main is not None and not isinstance(node, MappingNode):
        return {main: node}
    known = [field.name for field in fields]
    written = reading.fields(node, what, known, required, beside=SIBLING_KEYS)
    return None if written is None else written.nodes


def _literal(value: float | str | None) -> Literal | None:
    return None if value is None else Literal(value=value)
