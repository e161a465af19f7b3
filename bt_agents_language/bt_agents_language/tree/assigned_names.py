# SPDX-License-Identifier: Apache-2.0
"""Names that the nodes of a tree assign: keys of ``set`` and outputs of leaves."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_language.diagnostics.collection import nearest
from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import ANY_LABELS, ValueKind
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.fields.bindings import FEEDBACK, RECEIVED
from bt_agents_language.fields.inputs import read_new_name
from bt_agents_language.fields.interfaces import Interfaces, MessageFields
from bt_agents_language.fields.references import ONE_NAME, unmarked_expression
from bt_agents_language.fields.scope import KINDS, Assigned, NameScope
from bt_agents_language.fields.values import EXPECTED, may_be
from bt_agents_language.model.specs import NOTHING, FieldSpec, SubtreeSpec
from bt_agents_language.nodes.node_type import RawNode
from bt_agents_language.yaml.scalars import scalar_type
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import Node, Scalar, Sequence, entries_of

_Written = tuple[str, Scalar, FieldType, Node | None]
"""Name, its place, the type of its value, and the value if it is literal."""

_ONE_EXPRESSION = re.compile(r"\$\{([^{}$]*)\}")

_TRUTHS = ("true", "false")


class _Kind(NamedTuple):
    """Kind of the value that a node assigns, and whether it is ``written_out`` there."""

    kind: ValueKind
    node: str
    line: int
    written_out: bool


class AssignedNames:
    """Names that each node of a file assigns; types of fields need ``interfaces``."""

    def __init__(
        self,
        reading: TypedReader,
        subtrees: Mapping[str, SubtreeSpec],
        interfaces: Interfaces | None,
    ) -> None:
        self._reading = reading
        self._interfaces = interfaces
        self._types: dict[str, FieldType] = {}
        self._subtrees = subtrees

    def of_trees(
        self,
        trees: Iterable[RawNode | None],
        taken: Mapping[str, str],
        types: Mapping[str, FieldType],
        declared: Mapping[str, FieldType] = NOTHING,
    ) -> dict[str, Assigned]:
        """Return all names that nodes of the trees assign values to.

        It reports reserved and ``taken`` names (name → by what), and values that do not fit the
        ``declared`` type or other values of the same name; ``types`` are those of names that have
        a value from the start.
        """
        self._types = {**types, **declared}
        assigned: dict[str, Assigned] = {}
        first_kinds: dict[str, _Kind] = {}
        nodes = (node for tree in trees if tree is not None for node in tree.walk())
        for node in filter(may_write, nodes):
            for name, place, field_type, value in self._written_by(node):
                own = place.text == name
                if own and read_new_name(self._reading, place, "a value") is None:
                    continue
                if name in taken:
                    self._reading.error(
                        "name-taken",
                        place,
                        f"'{node.key.text}' gives '{name}' a value, but '{name}' is {taken[name]}",
                        f"rename the one or the other: {name}_2",
                    )
                line = place.position.line
                first = assigned.get(name)
                if name in declared:
                    # A literal value is read as a value of that type.
                    if value is None:
                        self._refuse_misfit(name, place, node, field_type, declared[name])
                    field_type = declared[name]
                elif (kind := KINDS.get(field_type) or _kind_of_expression(value)) is not None:
                    this = _Kind(kind, node.key.text, line, written_out=value is not None)
                    self._refuse_mixture(name, place, value, this, first_kinds.get(name))
                    first_kinds.setdefault(name, this)
                choices = _choices(node) if field_type is FieldType.TEXT else ()
                if first is None:
                    assigned[name] = Assigned(
                        type=field_type,
                        node=node.key.text,
                        line=line,
                        declared=name in declared,
                        choices=choices,
                    )
                else:
                    assigned[name] = replace(
                        first,
                        type=first.type if first.type is field_type else FieldType.ANY,
                        choices=(*first.choices, *choices) if first.choices and choices else (),
                    )
                self._types[name] = assigned[name].type
        return assigned

    def _refuse_misfit(
        self, name: str, place: Scalar, node: RawNode, given: FieldType, wanted: FieldType
    ) -> None:
        if not may_be(given, wanted):
            self._reading.error(
                "wrong-value",
                place,
                f"output '{name}': expected {EXPECTED[wanted]}, but '{node.key.text}' gives it "
                f"{EXPECTED[given]}",
                f"declare it as it is, {{{name}: {given.value}}}, or give it another value",
            )

    def _refuse_mixture(
        self, name: str, place: Scalar, value: Node | None, this: _Kind, first: _Kind | None
    ) -> None:
        written_out = first is not None and (this.written_out or first.written_out)
        if first is None or this.kind is first.kind or not written_out:
            return
        word = value.text if isinstance(value, Scalar) else ""
        truth = nearest(word, _TRUTHS) if first.kind is ValueKind.BOOLEAN else None
        hint = "give it values of one kind, or take another name here"
        if truth is not None:
            hint = f"did you mean '{truth}'?"
        message = (
            f"'{name}' gets {this.kind.one} here, but {first.kind.one} from '{first.node}' in "
            f"line {first.line}"
        )
        if isinstance(value, Scalar) and this.kind is ValueKind.TEXT:
            unmarked = unmarked_expression(value, NameScope(self._types))
            message, hint = unmarked or (message, hint)
        self._reading.error("wrong-value", place if value is None else value, message, hint)

    def below(self, raw: RawNode) -> set[str]:
        """Return the names that a node and all nodes below it assign."""
        return {name for node in filter(may_write, raw.walk()) for name in self.by(node)}

    def by(self, raw: RawNode) -> set[str]:
        """Return the names that a node itself assigns."""
        return {name for name, *_ in self._written_by(raw)}

    def _written_by(self, node: RawNode) -> Iterator[_Written]:
        declared = self._declared(node)
        if declared is not None:
            entry = node.siblings.get("outputs")
            if entry is None:
                yield from ((one.name, node.key, one.type, None) for one in declared)
                return
            types = {one.name: one.type for one in declared}
            for item in entries_of(entry.value):
                source = item.value.text if isinstance(item.value, Scalar) else ""
                yield item.key.text, item.key, types.get(source, FieldType.ANY), None
        elif node.type is None:
            return
        elif node.type.assigns:
            for item in entries_of(node.value):
                if "." in item.key.text:
                    continue  # a value of the scene, which is not a name of the tree
                yield item.key.text, item.key, self._type_of(item.value), item.value
        elif node.type.message is not None and isinstance(node.value, MappingNode):
            yield from self._message_outputs(node.type.message, node.value)

    def _type_of(self, node: Node) -> FieldType:
        match = ONE_NAME.fullmatch(node.text) if isinstance(node, Scalar) else None
        if match is not None:
            return self._types.get(match[1], FieldType.ANY)
        return (
            FieldType.BOOLEAN
            if _kind_of_expression(node) is ValueKind.BOOLEAN
            else scalar_type(node)
        )

    def _message_outputs(self, kind: BindingKind, value: MappingNode) -> Iterator[_Written]:
        named = value.get("type")
        type_name = named.text if isinstance(named, Scalar) else ""
        section = RECEIVED.get(kind, "message")
        message = MessageFields(self._interfaces, kind, type_name, section)
        feedback = MessageFields(self._interfaces, kind, type_name, FEEDBACK)
        for item in entries_of(value.get("outputs")):
            path = item.value.text if isinstance(item.value, Scalar) else ""
            fields, prefix = message, "msg" if kind is BindingKind.TOPIC else "result"
            if kind is BindingKind.ACTION and path.startswith(f"{FEEDBACK}."):
                fields, prefix = feedback, FEEDBACK
            yield item.key.text, item.key, fields.type_of(path.removeprefix(f"{prefix}.")), None

    def _declared(self, node: RawNode) -> tuple[FieldSpec, ...] | None:
        """Return the outputs of a skill, subtree or plug-in; None for other nodes."""
        if node.skill is not None:
            return node.skill.outputs
        if node.type is not None and node.type.gives:
            return tuple(
                FieldSpec(name=one.name, type=one.type, required=False)
                for one in node.type.gives.values()
            )
        if node.type is None or "outputs" not in node.type.siblings:
            return None
        if not isinstance(node.value, Scalar):
            return None
        called = self._subtrees.get(node.value.text)
        return called.outputs if called is not None else ()


def may_write(node: RawNode) -> bool:
    """Return whether a node may assign values to names; most do not."""
    if node.skill is not None:
        return bool(node.skill.outputs) or "outputs" in node.siblings
    return node.type is not None and node.type.writes


def _choices(node: RawNode) -> tuple[str, ...]:
    """Return the ``choices`` of a skill if they are plain texts; empty otherwise."""
    value = node.value.get("choices") if isinstance(node.value, MappingNode) else None
    items = value.items if node.skill is not None and isinstance(value, Sequence) else ()
    texts = [item.text for item in items if isinstance(item, Scalar) and "${" not in item.text]
    return tuple(texts) if len(texts) == len(items) else ()


def _kind_of_expression(node: Node | None) -> ValueKind | None:
    """Return the kind of a value that is one ``${…}``; None if known only at run time."""
    match = _ONE_EXPRESSION.fullmatch(node.text) if isinstance(node, Scalar) else None
    if match is None:
        return None
    try:
        return parse_expression(match[1], labels_of=lambda _: ANY_LABELS).kind
    except ExpressionError:
        return None
