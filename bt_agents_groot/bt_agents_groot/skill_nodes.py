# SPDX-License-Identifier: Apache-2.0
"""Import of custom leaves of BehaviorTree.CPP as skills of the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.document import Document, Model, ModelPort, node_id
from bt_agents_groot.naming import field_of, snake
from bt_agents_groot.own_nodes import RemarkFunction, given_ports, own_leaf, port_value
from bt_agents_groot.ports import field_type_of, pointed_at
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.translation import RemarkLevel
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode
from bt_agents_language.model.specs import SkillSpec
from bt_agents_language.nodes.catalogue import WORDS
from bt_agents_language.nodes.node_type import NodeType


@dataclass
class MissingSkill:
    """Skill that no file declares, as far as its uses show it."""

    name: str
    inputs: dict[str, FieldType] = field(default_factory=dict)
    outputs: dict[str, FieldType] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class _Signature:
    """Signature of a skill or plug-in: types of its fields, its outputs, its main field."""

    fields: Mapping[str, FieldType]
    outputs: tuple[str, ...] = ()
    main: str | None = None


@dataclass
class _Use:
    """Use of a skill while it is imported."""

    name: str
    signature: _Signature | None
    fields: dict[str, Data] = field(default_factory=dict)
    outputs: dict[str, Data] = field(default_factory=dict)


class SkillNodes:
    """Translator of custom leaves.

    Args:
        document: The file.
        skills: Known skills by name.
        plugins: Node types of plug-ins by key.

    Attributes:
        missing: Skills that are used but not known, by name.
    """

    def __init__(
        self, document: Document, skills: Mapping[str, SkillSpec], plugins: Mapping[str, NodeType]
    ) -> None:
        self.missing: dict[str, MissingSkill] = {}
        self._models = document.models
        self._signatures = {
            **{name: _of_skill(skill) for name, skill in skills.items()},
            **{key: _of_plugin(kind) for key, kind in plugins.items()},
        }

    def leaf(self, element: Element, names: TreeNames, remark: RemarkFunction) -> YamlNode:
        """Return the node for a custom element without children."""
        own = own_leaf(element, names, remark)
        if own is not None:
            return own
        name = _skill_name(element, remark)
        use = _Use(name, self._signatures.get(name))
        if use.signature is None:
            self.missing.setdefault(name, MissingSkill(name))
        model = self._models.get(node_id(element), Model(kind="Action"))
        for attribute in _ports(element, model):
            declared = model.ports.get(attribute.name, ModelPort(direction=""))
            direction = self._direction(use, attribute, declared, names, remark)
            if direction != "out":
                self._input(use, attribute, declared, names, remark)
            if direction != "in":
                self._output(use, attribute, declared, names, remark)
        return _skill_node(use, names)

    def _direction(
        self,
        use: _Use,
        attribute: Attribute,
        declared: ModelPort,
        names: TreeNames,
        remark: RemarkFunction,
    ) -> str:
        """Return whether a port is ``in``, ``out`` or ``both``."""
        signature, name = use.signature, field_of(attribute.name)
        if signature is not None and (name in signature.outputs or name in signature.fields):
            return "out" if name not in signature.fields else "in"
        if signature is not None or declared.direction:
            return declared.direction or "in"
        # Nothing declares it. An entry that nothing has set yet, but others use, is set here.
        entry = pointed_at(attribute.value)
        if entry is None or not names.is_new(entry):
            return "in"
        remark(
            RemarkLevel.NOTE,
            attribute,
            f"'{attribute.name}' is taken as an output, because nothing before it fills "
            f"{{{entry}}}",
        )
        return "out"

    def _input(
        self,
        use: _Use,
        attribute: Attribute,
        declared: ModelPort,
        names: TreeNames,
        remark: RemarkFunction,
    ) -> None:
        name = field_of(attribute.name)
        field_type = field_type_of(declared.type)
        if use.signature is not None:
            if name not in use.signature.fields:
                remark(
                    RemarkLevel.LOST, attribute, f"our skill '{use.name}' has no field '{name}'"
                )
                return
            field_type = use.signature.fields[name]
        use.fields[name] = port_value(attribute, field_type, names, remark)
        if use.signature is None:
            apparent = (
                field_type if field_type is not FieldType.ANY else _apparent_type(use.fields[name])
            )
            _merge_type(self.missing[use.name].inputs, name, apparent)

    def _output(
        self,
        use: _Use,
        attribute: Attribute,
        declared: ModelPort,
        names: TreeNames,
        remark: RemarkFunction,
    ) -> None:
        name, entry = field_of(attribute.name), pointed_at(attribute.value)
        if use.signature is None:
            _merge_type(self.missing[use.name].outputs, name, field_type_of(declared.type))
        elif name not in use.signature.outputs:
            remark(RemarkLevel.LOST, attribute, f"our skill '{use.name}' has no output '{name}'")
            return
        if entry is None:
            remark(
                RemarkLevel.NOTE,
                attribute,
                f"the output '{attribute.name}' is lost: '{attribute.value[:40]}' names no entry",
            )
            return
        use.outputs[names.rename(entry)] = name


def _skill_name(element: Element, remark: RemarkFunction) -> str:
    name = snake(node_id(element))
    if name not in WORDS:
        return name
    remark(
        RemarkLevel.NOTE,
        element,
        f"'{name}' is a word of our language, so the skill is called '{name}_skill'",
    )
    return f"{name}_skill"


def _ports(element: Element, model: Model) -> list[Attribute]:
    """Return the ports of an element, with those that point at an entry by default."""
    ports = given_ports(element)
    written = {attribute.name for attribute in ports}
    ports += [
        Attribute(name=name, value=one.default, position=element.position, span=(0, 0))
        for name, one in model.ports.items()
        if name not in written and pointed_at(one.default) is not None
    ]
    # '{=}' stands for the entry that is called as the port is.
    return [
        replace(one, value=f"{{{one.name}}}") if pointed_at(one.value) == "=" else one
        for one in ports
    ]


def _skill_node(use: _Use, names: TreeNames) -> YamlNode:
    signature, outputs = use.signature, use.outputs
    usual = {name: name for name in signature.outputs} if signature is not None else {}
    for name in outputs or usual:
        names.write(name)
    value: Data = use.fields
    if (
        signature is not None
        and signature.main is not None
        and list(use.fields) == [signature.main]
    ):
        only = use.fields[signature.main]
        value = use.fields if isinstance(only, dict) else only
    siblings: dict[str, Data] = {"outputs": outputs} if outputs and outputs != usual else {}
    return YamlNode(key=use.name, value=value, siblings=siblings)


def _merge_type(types: dict[str, FieldType], name: str, apparent: FieldType) -> None:
    types[name] = apparent if types.get(name, apparent) is apparent else FieldType.ANY


def _of_skill(skill: SkillSpec) -> _Signature:
    return _Signature(
        fields={one.name: one.type for one in skill.inputs},
        outputs=tuple(one.name for one in skill.outputs),
        main=skill.main,
    )


def _of_plugin(node_type: NodeType) -> _Signature:
    return _Signature(fields={one.name: one.type for one in node_type.fields}, main=node_type.main)


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
