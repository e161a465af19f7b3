# SPDX-License-Identifier: Apache-2.0
"""Drafts turned into checked nodes: values read, modifiers wrapped around, paths given."""

from __future__ import annotations

import re
from collections.abc import Mapping

from bt_agents.language.diagnostics import did_you_mean, shown
from bt_agents.language.drafts import Draft
from bt_agents.language.expressions import Expression
from bt_agents.language.interfaces import read_ros_name, read_ros_type
from bt_agents.language.names import FieldCheck, Names
from bt_agents.language.nodes import MODIFIERS, Children, Content, ModifierKind, NodeField
from bt_agents.language.raw_leaves import RAW_LEAVES, read_raw_leaf
from bt_agents.language.shape import Fields, FileReading
from bt_agents.language.specs import (
    BindingKind,
    FieldSpec,
    FieldType,
    Literal,
    NodeSpec,
    Position,
    Value,
)
from bt_agents.language.values import read_condition, read_value
from bt_agents.language.vocabulary import Vocabulary
from bt_agents.language.yaml_reader import Mapping as MappingNode
from bt_agents.language.yaml_reader import Node, Scalar

FieldValues = dict[str, Value | Expression]

_LABEL_LENGTH = 24
_NOT_IN_PATH = re.compile(r"[^\w-]+")


class TreeReader:
    """Reads the trees of one agent file.

    Attributes:
        calls: Place of each ``subtree`` node → name of the subtree.
    """

    def __init__(
        self,
        reading: FileReading,
        vocabulary: Vocabulary,
        subtrees: Mapping[str, tuple[FieldSpec, ...]],
    ) -> None:
        """Take what nodes may refer to; ``subtrees`` gives the inputs of each."""
        self.calls: dict[Position, str] = {}
        self._reading = reading
        self._vocabulary = vocabulary
        self._subtrees = subtrees

    def read(
        self, draft: Draft, path: str, names: Names, *, in_selector: bool = False
    ) -> NodeSpec | None:
        """Return a node with everything below it; None when it is wrong, which is then reported.

        Args:
            draft: The node as written.
            path: Its path.
            names: What its values and conditions may name.
            in_selector: Whether its parent is a selector.
        """
        spec = self._node(draft, path, names)
        for kind in reversed(list(MODIFIERS.values())):
            entry = draft.modifiers.get(kind.key)
            if entry is None:
                continue
            if kind.key == "on_failure":
                spec = self._handled(draft, entry.key.position, path, names, spec)
            elif kind.key == "invert":
                if self._reading.boolean(entry.value, "'invert'"):
                    spec = _wrapped(spec, kind, entry.key.position, path, {}, kind.key)
            else:
                fields = self._modifier_fields(kind, entry.value, names)
                if kind.key == "when":
                    fields["otherwise"] = Literal(value="failure" if in_selector else "success")
                label = f"{kind.key} {_short(entry.value)}"
                spec = _wrapped(spec, kind, entry.key.position, path, fields, label)
        return spec

    def _modifier_fields(self, kind: ModifierKind, node: Node, names: Names) -> FieldValues:
        assert kind.field is not None
        value = self._field(kind.field, node, names, f"'{kind.key}'", {})
        return {} if value is None else {kind.field.name: value}

    def _handled(
        self, draft: Draft, position: Position, path: str, names: Names, spec: NodeSpec | None
    ) -> NodeSpec | None:
        if draft.handler is None:
            return None
        here = f"{path}@on_failure"
        handler = self.read(draft.handler, f"{here}/{_segment(0, draft.handler)}", names)
        if spec is None or handler is None:
            return None
        return NodeSpec(
            path=here,
            position=position,
            kind="on_failure",
            name="on_failure",
            children=(spec, handler),
        )

    def _node(self, draft: Draft, path: str, names: Names) -> NodeSpec | None:
        if draft.skill is not None:
            return self._skill(draft, path, names)
        assert draft.kind is not None
        key = draft.kind.key
        if draft.kind.children is Children.LIST:
            return self._composite(draft, path, names)
        if key == "subtree":
            return self._subtree(draft, path, names)
        if key == "set":
            return self._set(draft, path, names)
        if key in RAW_LEAVES:
            leaf = read_raw_leaf(
                self._reading, draft, RAW_LEAVES[key], names, self._vocabulary.interfaces
            )
            if leaf is None:
                return None
            skill, label = leaf
            return NodeSpec(
                path=path,
                position=draft.key.position,
                kind=key,
                name=draft.name or f"{key} {label}",
                skill=skill,
            )
        return self._leaf(draft, path, names)

    def _composite(self, draft: Draft, path: str, names: Names) -> NodeSpec | None:
        assert draft.kind is not None
        fields: FieldValues = {}
        for field in draft.kind.fields:
            entry = draft.options.get(field.name)
            if entry is None:
                fields[field.name] = Literal(value=field.default)
                continue
            value = self._field(field, entry.value, names, f"'{field.name}'", {})
            if value is not None:
                fields[field.name] = value
        children = tuple(
            self.read(
                child,
                f"{path}/{_segment(index, child)}",
                names,
                in_selector=draft.kind.key == "selector",
            )
            for index, child in enumerate(draft.children)
        )
        return NodeSpec(
            path=path,
            position=draft.key.position,
            kind=draft.kind.key,
            name=draft.name or draft.kind.key,
            fields=fields,
            children=tuple(child for child in children if child is not None),
        )

    def _leaf(self, draft: Draft, path: str, names: Names) -> NodeSpec | None:
        kind = draft.kind
        assert kind is not None
        what = f"'{kind.key}'"
        required = [field.name for field in kind.fields if field.required]
        if isinstance(draft.value, MappingNode) or kind.main is None:
            known = [field.name for field in kind.fields]
            written = self._reading.fields(draft.value, what, known, required)
            if written is None:
                return None
            nodes = written.nodes
        else:
            nodes = {kind.main: draft.value}
        fields: FieldValues = {}
        for field in kind.fields:
            node = nodes.get(field.name)
            if node is None:
                continue
            label = what if field.name == kind.main else f"'{field.name}'"
            value = self._field(field, node, names, label, nodes)
            if value is not None:
                fields[field.name] = value
        shortened = _short(nodes.get(kind.main or kind.fields[0].name))
        return NodeSpec(
            path=path,
            position=draft.key.position,
            kind=kind.key,
            name=draft.name or f"{kind.key} {shortened}",
            fields=fields,
        )

    def _field(
        self, field: NodeField, node: Node, names: Names, what: str, beside: Mapping[str, Node]
    ) -> Value | Expression | None:
        """Return what is written in a field of the table of nodes.

        Args:
            field: Its entry in the table.
            node: What is written.
            names: What it may name.
            what: The field, for messages.
            beside: Other fields of the node.
        """
        match field.content:
            case Content.VALUE:
                return read_value(self._reading, node, field.type, names, what, field.minimum)
            case Content.CONDITION:
                if field.message:
                    names = names.and_message(field.message, self._message_check(beside))
                return read_condition(self._reading, node, names, what)
            case Content.ROS_NAME:
                return _literal(read_ros_name(self._reading, node, what))
            case Content.ROS_TYPE:
                interfaces = self._vocabulary.interfaces
                return _literal(read_ros_type(self._reading, node, BindingKind.TOPIC, interfaces))
            case Content.CONSTANT:
                if field.words:
                    return _literal(self._reading.choice(node, what, field.words))
                return _literal(self._reading.boolean(node, what))

    def _message_check(self, beside: Mapping[str, Node]) -> FieldCheck:
        interfaces = self._vocabulary.interfaces
        node = beside.get("type")
        type_name = node.text if isinstance(node, Scalar) else ""

        def check(path: str) -> str | None:
            if interfaces is None or interfaces.type_problem(BindingKind.TOPIC, type_name):
                return None
            return interfaces.field_problem(BindingKind.TOPIC, type_name, "message", path)

        return check

    def _set(self, draft: Draft, path: str, names: Names) -> NodeSpec | None:
        entries = self._reading.entries(draft.value, "'set'", "names and values")
        if isinstance(draft.value, MappingNode) and not entries:
            self._reading.error(
                "missing-value", draft.value, "'set' sets nothing", "write set: {name: value}"
            )
        fields: FieldValues = {}
        for entry in entries:
            value = read_value(
                self._reading, entry.value, FieldType.ANY, names, f"'{entry.key.text}'"
            )
            if value is not None:
                fields[entry.key.text] = value
        return NodeSpec(
            path=path,
            position=draft.key.position,
            kind="set",
            name=draft.name or f"set {', '.join(fields)}"[:_LABEL_LENGTH],
            fields=fields,
        )

    def _skill(self, draft: Draft, path: str, names: Names) -> NodeSpec | None:
        skill = draft.skill
        assert skill is not None
        nodes: dict[str, Node] = {}
        value = draft.value
        if isinstance(value, MappingNode):
            known = [one.name for one in skill.inputs]
            required = [one.name for one in skill.inputs if one.required]
            fields = self._reading.fields(value, f"'{skill.name}'", known, required)
            nodes = fields.nodes if fields is not None else {}
        elif not self._all_defaults(draft):
            if skill.main is None:
                words = ", ".join(f"{one.name}: …" for one in skill.inputs)
                self._reading.wrong_type(value, f"'{skill.name}'", f"its fields {{{words}}}")
                return None
            nodes = {skill.main: value}
            missing = [o.name for o in skill.inputs if o.required and o.name != skill.main]
            if missing:
                self._reading.error(
                    "missing-key",
                    value,
                    f"'{skill.name}' needs also {', '.join(missing)}",
                    f"write {skill.name}: {{{skill.main}: …, {missing[0]}: …}}",
                )
        return NodeSpec(
            path=path,
            position=draft.key.position,
            kind=skill.name,
            name=draft.name or self._skill_label(draft, nodes),
            fields=self._inputs(skill.inputs, nodes, names),
            skill=skill,
        )

    def _all_defaults(self, draft: Draft) -> bool:
        assert draft.skill is not None
        optional = not any(one.required for one in draft.skill.inputs)
        return isinstance(draft.value, Scalar) and draft.value.empty and optional

    def _skill_label(self, draft: Draft, nodes: Mapping[str, Node]) -> str:
        skill = draft.skill
        assert skill is not None
        shortened = _short(nodes.get(skill.main or ""))
        types = {one.name: one.type for one in skill.inputs}
        if shortened and types.get(skill.main or "") is FieldType.TEXT:
            shortened = f'"{shortened}"'
        return f"{skill.name} {shortened}".rstrip()

    def _inputs(
        self, inputs: tuple[FieldSpec, ...], nodes: Mapping[str, Node], names: Names
    ) -> FieldValues:
        fields: FieldValues = {}
        for one in inputs:
            node = nodes.get(one.name)
            if node is None:
                if not one.required:
                    fields[one.name] = Literal(value=one.default)
                continue
            value = read_value(self._reading, node, one.type, names, f"'{one.name}'")
            if value is not None:
                fields[one.name] = value
        return fields

    def _subtree(self, draft: Draft, path: str, names: Names) -> NodeSpec | None:
        called = self._reading.text(draft.value, "the name of a subtree")
        if called is None:
            return None
        if called not in self._subtrees:
            self._reading.error(
                "unknown-subtree",
                draft.value,
                f"there is no subtree {shown(called)}",
                did_you_mean(called, self._subtrees) or "declare it under 'subtrees:'",
            )
            return None
        inputs = self._subtrees[called]
        given = self._given(draft, called, inputs)
        position = draft.key.position
        self.calls[position] = called
        return NodeSpec(
            path=path,
            position=position,
            kind="subtree",
            name=draft.name or f"subtree {called}",
            fields=self._inputs(inputs, given.nodes if given is not None else {}, names),
        )

    def _given(self, draft: Draft, called: str, inputs: tuple[FieldSpec, ...]) -> Fields | None:
        required = [one.name for one in inputs if one.required]
        if draft.inputs is None:
            if required:
                self._reading.error(
                    "missing-key",
                    draft.value,
                    f"subtree '{called}' needs the inputs {', '.join(required)}",
                    f"add 'with: {{{required[0]}: …}}' beside 'subtree'",
                )
            return None
        known = [one.name for one in inputs]
        if not known:
            self._reading.error(
                "unknown-key",
                draft.inputs.key,
                f"subtree '{called}' has no inputs",
                "remove 'with'",
            )
            return None
        what = f"'with' of subtree '{called}'"
        return self._reading.fields(draft.inputs.value, what, known, required)


def _wrapped(
    spec: NodeSpec | None,
    kind: ModifierKind,
    position: Position,
    path: str,
    fields: FieldValues,
    label: str,
) -> NodeSpec | None:
    if spec is None:
        return None
    return NodeSpec(
        path=f"{path}@{kind.key}",
        position=position,
        kind=kind.key,
        name=label,
        fields=fields,
        children=(spec,),
    )


def _literal(value: bool | str | None) -> Literal | None:
    return None if value is None else Literal(value=value)


def _segment(index: int, draft: Draft) -> str:
    word = _NOT_IN_PATH.sub("_", draft.name).strip("_") or draft.key.text
    return f"{index}.{word}"


def _short(node: Node | None) -> str:
    if not isinstance(node, Scalar):
        return "" if node is None else "…"
    flat = " ".join(node.text.split())
    return flat if len(flat) <= _LABEL_LENGTH else f"{flat[: _LABEL_LENGTH - 1]}…"
