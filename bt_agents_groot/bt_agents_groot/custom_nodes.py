# SPDX-License-Identifier: Apache-2.0
"""Import of custom nodes as words of our language, or else as skills of the robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import WRITTEN_PORTS
from bt_agents_groot.document import Document, Model, ModelPort, given_ports, node_id
from bt_agents_groot.naming import entry_of, field_of, output_of, port, snake
from bt_agents_groot.ports import (
    PortError,
    field_type_of,
    from_port,
    names_of_expression,
    pointed_at,
)
from bt_agents_groot.scopes import usual_value
from bt_agents_groot.simple_nodes import unknown_parent
from bt_agents_groot.tree_import import TreeImport
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, decorated
from bt_agents_language.fields.scope import RESERVED
from bt_agents_language.fields.values import ONE_OF
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES, WORDS
from bt_agents_language.nodes.node_type import Children, Content, NodeType
from bt_agents_language.nodes.parallel import PARALLEL
from bt_agents_language.nodes.random import RANDOM
from bt_agents_language.nodes.selector import SELECTOR
from bt_agents_language.nodes.sequence import SEQUENCE
from bt_agents_language.nodes.symbols import SymbolTable

_ERRORS = {"error_code_id": FieldType.INTEGER, "error_msg": FieldType.TEXT}
"""Outputs of Nav2's actions that are 0 and empty without an error."""


def _own_leaf(tree: TreeImport, element: Element) -> YamlNode | None:
    own = NODE_TYPES.get(node_id(element))
    if own is None or own.children is not Children.NONE:
        return None
    if own.open:
        values = element.attributes.get("values")
        data = _port_value(tree, values, FieldType.ANY) if values is not None else None
        fields = data if isinstance(data, dict) else None
    else:
        fields = _own_fields(tree, element, own)
    if fields is None:
        return None
    outputs = fields.get("outputs") if not own.open else fields if own.assigns else None
    for name in outputs if isinstance(outputs, dict) else ():
        tree.names.write(name)
    return YamlNode(key=own.key, value=_value(own, fields))


def _own_decorator(tree: TreeImport, element: Element) -> YamlNode | None:
    own = DECORATORS.get(node_id(element))
    if own is None or own.main is None or len(element.children) != 1:
        return None
    fields = _own_fields(tree, element, own)
    if fields is None:
        return None
    return decorated(tree.node(element.children[0]), own.key, _value(own, fields))


def _own_control(tree: TreeImport, element: Element) -> YamlNode | None:
    """Return the node for one of our composites, or None for anything else."""
    ports = {attribute.name for attribute in given_ports(element)}
    own_key = node_id(element)
    options: dict[str, Data] = {}
    if own_key in (SEQUENCE.key, SELECTOR.key) and ports == {"memory"}:
        options = {"memory": element.get("memory") != "false"}
    elif own_key == PARALLEL.key and ports == {"succeed_on"}:
        options = {"succeed_on": tree.port(element, element.get("succeed_on"), FieldType.ANY)}
    if options:
        return YamlNode(
            key=own_key, value=options, children=tuple(map(tree.node, element.children))
        )
    own_ports = [one.name for one in RANDOM.fields]
    if own_key != RANDOM.key or not ports <= {*own_ports, "weights"}:
        return None
    weights = tree.port(element, element.get("weights", "json:[]"), FieldType.NUMBER)
    if not isinstance(weights, list) or len(weights) not in (0, len(element.children)):
        return None
    chosen = [tree.node(child) for child in element.children]
    for number, weight in enumerate(weights):
        if weight != 1:
            value = Raw(weight) if isinstance(weight, str) else weight
            siblings = {**chosen[number].siblings, "weight": value}
            chosen[number] = replace(chosen[number], siblings=siblings)
    texts = {name: element.get(name) for name in own_ports}
    options = {name: Raw(text) for name, text in texts.items() if text}
    return YamlNode(key=RANDOM.key, value=options, children=tuple(chosen))


def _own_fields(tree: TreeImport, element: Element, own: NodeType) -> dict[str, Data] | None:
    """Return the fields of a node of our language; None if the ports are not those fields."""
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
            tree.names.mention(names_of_expression(attribute.value))
            fields[one.name] = Raw(attribute.value)
        else:
            fields[one.name] = _port_value(tree, attribute, one.type)
    return fields


def _value(own: NodeType, fields: dict[str, Data]) -> Data:
    return fields[own.main] if own.main is not None and list(fields) == [own.main] else fields


def _port_value(tree: TreeImport, attribute: Attribute, field_type: FieldType) -> Data:
    """Return the value of a port; record the names in it as read."""
    data = tree.port(attribute, attribute.value, field_type)
    if isinstance(data, str) and "${" in data.replace("$${", ""):
        tree.note(attribute, "the ${…} in it is taken as a name of our language")
    return data


@dataclass
class MissingSkill:
    """Skill that no file declares, as far as its uses reveal it.

    Attributes:
        defaults: Optional input → its default value.
    """

    name: str
    inputs: dict[str, FieldType] = field(default_factory=dict)
    outputs: dict[str, FieldType] = field(default_factory=dict)
    defaults: dict[str, Data] = field(default_factory=dict)
    uses: int = 0
    given: Counter[str] = field(default_factory=Counter)

    def default(self, name: str) -> Data | None:
        """Return the value of an input that some use leaves out; None if every use gives it."""
        if name in self.defaults or self.given[name] == self.uses:
            return self.defaults.get(name)
        return usual_value(self.inputs[name])


@dataclass(frozen=True)
class _Signature:
    """Signature of a skill or plug-in: the types of its fields, its main field, its outputs."""

    fields: Mapping[str, FieldType]
    main: str | None
    outputs: tuple[str, ...] = ()


@dataclass
class _Use:
    name: str
    signature: _Signature | None
    fields: dict[str, Data] = field(default_factory=dict)
    outputs: dict[str, Data] = field(default_factory=dict)


class CustomNodes:
    """Translator of custom nodes.

    Attributes:
        missing: Used but unknown skills, by name.
    """

    def __init__(self, document: Document, symbols: SymbolTable) -> None:
        self.missing: dict[str, MissingSkill] = {}
        self._models = {**document.subtree_models, **document.models}
        self._directions: dict[tuple[str, str], str] = {}
        self._signatures: dict[str, _Signature] = {}
        for name, skill in symbols.skills.items():
            types = {one.name: one.type for one in skill.inputs}
            outputs = tuple(one.name for one in skill.outputs)
            self._signatures[name] = _Signature(types, skill.main, outputs)
        for key, plugin in symbols.plugins.items():
            types = {one.name: one.type for one in plugin.fields}
            self._signatures[key] = _Signature(types, plugin.main)

    def node(self, tree: TreeImport, element: Element) -> YamlNode:
        """Return the node for a custom element."""
        if not element.children:
            return _own_leaf(tree, element) or self.skill(tree, element)
        return (
            _own_control(tree, element)
            or _own_decorator(tree, element)
            or unknown_parent(tree, element)
        )

    def skill(self, tree: TreeImport, element: Element) -> YamlNode:
        """Return the node for the skill with the name of an element."""
        name = snake(node_id(element))
        if name in WORDS:
            tree.note(
                element,
                f"'{name}' is a word of our language, so the skill is called '{name}_skill'",
            )
            name = f"{name}_skill"
        use = _Use(name, self._signatures.get(name))
        known = self._models.get(node_id(element))
        model = known or _usual_model(element)
        if use.signature is None:
            self._missing_skill(name, model).uses += 1
        for attribute in _ports(element, model):
            declared = model.ports.get(attribute.name, ModelPort(direction=""))
            port_key = name, attribute.name
            if port_key not in self._directions:
                self._directions[port_key] = _direction(tree, use, attribute, declared)
                _note_name(tree, attribute)
                if known is not None and attribute.name not in known.ports:
                    tree.note(attribute, f"the model of <{node_id(element)}> has no such port")
            direction = self._directions[port_key]
            if direction != "out":
                self._input(tree, use, attribute, declared)
            # An inout port with a constant is only read.
            if direction == "out" or (direction == "both" and pointed_at(attribute.value)):
                self._output(tree, use, attribute, declared)
        return _skill_node(tree, use)

    def _missing_skill(self, name: str, model: Model) -> MissingSkill:
        """Return an undeclared skill, with its inputs that have default values."""
        if name not in self.missing:
            skill = self.missing[name] = MissingSkill(name)
            for port_name, one in model.ports.items():
                if one.value and one.direction != "out":
                    declared = field_of(port_name)
                    skill.inputs[declared], skill.defaults[declared] = _by_default(one)
        return self.missing[name]

    def _input(
        self, tree: TreeImport, use: _Use, attribute: Attribute, declared: ModelPort
    ) -> None:
        name, field_type = field_of(attribute.name), field_type_of(declared.type)
        if use.signature is not None:
            if name not in use.signature.fields:
                tree.lost(attribute, f"our skill '{use.name}' has no field '{name}'")
                return
            field_type = use.signature.fields[name]
        data = use.fields[name] = _port_value(tree, attribute, field_type)
        if use.signature is None:
            apparent = _apparent_type(data) if field_type is FieldType.ANY else field_type
            skill = self.missing[use.name]
            _merge_type(skill.inputs, name, apparent)
            skill.given[name] += 1

    def _output(
        self, tree: TreeImport, use: _Use, attribute: Attribute, declared: ModelPort
    ) -> None:
        name, entry = field_of(attribute.name), pointed_at(attribute.value)
        if use.signature is not None and name not in use.signature.outputs:
            name = output_of(name, use.signature.fields)
        if use.signature is None:
            _merge_type(self.missing[use.name].outputs, name, field_type_of(declared.type))
        elif name not in use.signature.outputs:
            tree.lost(attribute, f"our skill '{use.name}' has no output '{name}'")
            return
        if entry is None:
            shown = f"'{attribute.value[:40]}' names no entry"
            tree.note(attribute, f"the output '{attribute.name}' is lost: {shown}")
            return
        if name in _ERRORS and tree.names.is_new(entry):
            # Other nodes may read it before the first error.
            tree.names.read([tree.names.rename(entry)], _ERRORS[name])
        use.outputs[tree.names.rename(entry)] = name


def _usual_model(element: Element) -> Model:
    """Return Nav2's model of an element that the file does not declare, if any."""
    written = WRITTEN_PORTS.get(node_id(element))
    if written is None:
        return Model(kind="Action")
    directions = {one.name: "out" if one.name in written else "in" for one in given_ports(element)}
    ports = {name: ModelPort(direction=direction) for name, direction in directions.items()}
    return Model(kind="Action", ports=ports)


def _note_name(tree: TreeImport, attribute: Attribute) -> None:
    if entry_of(attribute.name) in RESERVED:
        tree.note(
            attribute,
            f"'{attribute.name}' means something in our expressions, so it is called "
            f"'{field_of(attribute.name)}'",
        )


def _direction(tree: TreeImport, use: _Use, attribute: Attribute, declared: ModelPort) -> str:
    """Return whether a port is ``in``, ``out`` or ``both``."""
    signature, name = use.signature, field_of(attribute.name)
    if signature is not None and (name in signature.outputs) != (name in signature.fields):
        return "out" if name in signature.outputs else "in"
    if signature is not None or declared.direction:
        return declared.direction or "in"
    # It has no declaration. An entry that is not set yet, but used elsewhere, is set here.
    entry = pointed_at(attribute.value)
    if entry is None or not tree.names.is_new(entry):
        return "in"
    tree.note(
        attribute,
        f"'{attribute.name}' is taken as an output, because nothing before it fills {{{entry}}}",
    )
    return "out"


def _ports(element: Element, model: Model) -> list[Attribute]:
    """Return the ports of an element, including those that point at an entry by default."""
    ports = given_ports(element)
    given = {attribute.name for attribute in ports}
    ports += [
        Attribute(name=name, value=one.default, position=element.position, span=(0, 0))
        for name, one in model.ports.items()
        if name not in given and pointed_at(one.default) is not None
    ]
    # '{=}' means the entry with the name of the port.
    return [
        replace(one, value=f"{{{one.name}}}") if pointed_at(one.value) == "=" else one
        for one in ports
    ]


def _skill_node(tree: TreeImport, use: _Use) -> YamlNode:
    signature = use.signature or _Signature({}, None)
    usual = {name: name for name in signature.outputs}
    for name in use.outputs or usual:
        tree.names.write(name)
    value: Data = use.fields
    main = use.fields.get(signature.main or "")
    if isinstance(main, dict) and list(main) == [ONE_OF]:
        value = {**{k: v for k, v in use.fields.items() if k != signature.main}, **main}
    elif list(use.fields) == [signature.main]:
        [only] = use.fields.values()
        value = use.fields if isinstance(only, dict) else only
    outputs = use.outputs if use.outputs != usual else {}
    return YamlNode(key=use.name, value=value, siblings={"outputs": outputs} if outputs else {})


def _by_default(declared: ModelPort) -> tuple[FieldType, Data]:
    """Return the type and default value of a port; any type if the two do not fit."""
    field_type = field_type_of(declared.type)
    try:
        value = from_port(declared.value, field_type, str)
    except PortError:
        return FieldType.ANY, declared.value
    numeric = (FieldType.INTEGER, FieldType.NUMBER)
    fits = {FieldType.NUMBER: numeric}.get(field_type, (field_type,))
    plain = field_type in (*numeric, FieldType.BOOLEAN)
    return (FieldType.ANY if plain and _apparent_type(value) not in fits else field_type), value


def _merge_type(types: dict[str, FieldType], name: str, apparent: FieldType) -> None:
    types[name] = apparent if types.get(name, apparent) is apparent else FieldType.ANY


def _apparent_type(data: Data) -> FieldType:
    """Return the type that the form of a value suggests."""
    match data:
        case Raw(text) if "$" in text:
            return FieldType.ANY
        case Raw(text) if text.lower() in ("true", "false"):
            return FieldType.BOOLEAN
        case Raw(text) if text.lstrip("+-").isdigit():
            return FieldType.INTEGER
        case Raw(text) if text[-1:].isdigit():
            return FieldType.NUMBER
        case str():
            return FieldType.TEXT
    return FieldType.ANY
