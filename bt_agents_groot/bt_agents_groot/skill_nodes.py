# SPDX-License-Identifier: Apache-2.0
"""Custom leaves of BehaviorTree.CPP as skills of the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.document import Document, Model, ModelPort, node_id
from bt_agents_groot.own_words import Remarking, own_leaf, port_value, written_ports
from bt_agents_groot.port_types import read_type
from bt_agents_groot.ports import pointed_at
from bt_agents_groot.remarks import RemarkLevel
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.words import field_of, snake
from bt_agents_groot.written import Data, Raw, YamlNode
from bt_agents_groot.xml_reader import Attribute, Element
from bt_agents_language.model.specs import SkillSpec
from bt_agents_language.nodes.catalogue import WORDS
from bt_agents_language.nodes.node_type import NodeType


@dataclass
class MissingSkill:
    """A skill that nobody has declared yet, as far as its uses show it."""

    name: str
    inputs: dict[str, FieldType] = field(default_factory=dict)
    outputs: dict[str, FieldType] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class _Word:
    """What is known of a skill or plug-in: types of its fields, its outputs, its main field."""

    fields: Mapping[str, FieldType]
    outputs: tuple[str, ...] = ()
    main: str | None = None


@dataclass
class _Use:
    """One use of a skill while it is read."""

    name: str
    word: _Word | None
    fields: dict[str, Data] = field(default_factory=dict)
    outputs: dict[str, Data] = field(default_factory=dict)


class SkillNodes:
    """Translates custom leaves.

    Attributes:
        missing: Skills that are used but not known, by name.
    """

    def __init__(
        self,
        document: Document,
        skills: Mapping[str, SkillSpec],
        plugins: Mapping[str, NodeType],
    ) -> None:
        """Take the file and the known words."""
        self.missing: dict[str, MissingSkill] = {}
        self._models = document.models
        self._words = {
            **{name: _of_skill(skill) for name, skill in skills.items()},
            **{key: _of_plugin(kind) for key, kind in plugins.items()},
        }

    def leaf(self, element: Element, names: TreeNames, remark: Remarking) -> YamlNode:
        """Return the node for a custom element without children."""
        own = own_leaf(element, names, remark)
        if own is not None:
            return own
        name = _skill_name(element, remark)
        use = _Use(name, self._words.get(name))
        if use.word is None:
            self.missing.setdefault(name, MissingSkill(name))
        model = self._models.get(node_id(element), Model(kind="Action"))
        for attribute in _ports(element, model):
            declared = model.ports.get(attribute.name, ModelPort(direction=""))
            direction = self._direction(use, attribute, declared, names, remark)
            if direction != "out":
                self._input(use, attribute, declared, names, remark)
            if direction != "in":
                self._output(use, attribute, declared, names, remark)
        return _written(use, names)

    def _direction(
        self,
        use: _Use,
        attribute: Attribute,
        declared: ModelPort,
        names: TreeNames,
        remark: Remarking,
    ) -> str:
        """Return whether a port is ``in``, ``out`` or ``both``."""
        word, name = use.word, field_of(attribute.name)
        if word is not None and (name in word.outputs or name in word.fields):
            return "out" if name not in word.fields else "in"
        if word is not None or declared.direction:
            return declared.direction or "in"
        # Nothing says what it is. What nothing has filled yet, but others use, is filled here.
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
        remark: Remarking,
    ) -> None:
        name = field_of(attribute.name)
        field_type = read_type(declared.type)
        if use.word is not None:
            if name not in use.word.fields:
                remark(
                    RemarkLevel.LOST, attribute, f"our skill '{use.name}' has no field '{name}'"
                )
                return
            field_type = use.word.fields[name]
        use.fields[name] = port_value(attribute, field_type, names, remark)
        if use.word is None:
            seen = field_type if field_type is not FieldType.ANY else _seen(use.fields[name])
            _note(self.missing[use.name].inputs, name, seen)

    def _output(
        self,
        use: _Use,
        attribute: Attribute,
        declared: ModelPort,
        names: TreeNames,
        remark: Remarking,
    ) -> None:
        name, entry = field_of(attribute.name), pointed_at(attribute.value)
        if use.word is None:
            _note(self.missing[use.name].outputs, name, read_type(declared.type))
        elif name not in use.word.outputs:
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


def _skill_name(element: Element, remark: Remarking) -> str:
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
    """Return the ports of an element, those included that point at an entry by default."""
    ports = written_ports(element)
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


def _written(use: _Use, names: TreeNames) -> YamlNode:
    word, outputs = use.word, use.outputs
    usual = {name: name for name in word.outputs} if word is not None else {}
    for name in outputs or usual:
        names.write(name)
    value: Data = use.fields
    if word is not None and word.main is not None and list(use.fields) == [word.main]:
        only = use.fields[word.main]
        value = use.fields if isinstance(only, dict) else only
    siblings: dict[str, Data] = {"outputs": outputs} if outputs and outputs != usual else {}
    return YamlNode(key=use.name, value=value, siblings=siblings)


def _note(types: dict[str, FieldType], name: str, seen: FieldType) -> None:
    types[name] = seen if types.get(name, seen) is seen else FieldType.ANY


def _of_skill(skill: SkillSpec) -> _Word:
    return _Word(
        fields={one.name: one.type for one in skill.inputs},
        outputs=tuple(one.name for one in skill.outputs),
        main=skill.main,
    )


def _of_plugin(node_type: NodeType) -> _Word:
    return _Word(fields={one.name: one.type for one in node_type.fields}, main=node_type.main)


def _seen(data: Data) -> FieldType:
    """Return the type that a value has by its looks."""
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
