# SPDX-License-Identifier: Apache-2.0
"""Names that the nodes of a tree assign: keys of ``set`` and outputs of leaves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_language.fields.bindings import FEEDBACK
from bt_agents_language.fields.inputs import read_new_name
from bt_agents_language.fields.interfaces import Interfaces, MessageFields
from bt_agents_language.fields.references import ONE_NAME
from bt_agents_language.fields.scope import Assigned
from bt_agents_language.model.specs import FieldSpec, SubtreeSpec
from bt_agents_language.nodes.node_type import MessageSource, RawNode
from bt_agents_language.yaml.scalars import scalar_type
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import Node, Scalar, entries_of


class AssignedNames:
    """Knows what each node of a file writes; types of fields need ``interfaces``."""

    def __init__(
        self,
        reading: TypedReader,
        subtrees: Mapping[str, SubtreeSpec],
        interfaces: Interfaces | None,
    ) -> None:
        self._reading = reading
        self._interfaces = interfaces
        self._types: Mapping[str, FieldType] = {}
        self._subtrees = subtrees

    def of_trees(
        self,
        trees: Iterable[RawNode | None],
        taken: Mapping[str, str],
        types: Mapping[str, FieldType],
    ) -> dict[str, Assigned]:
        """Return every name that some node of the trees gives a value.

        What is reserved or ``taken`` (name → by what) is reported; ``types`` are those of names
        that have a value from the start.
        """
        self._types = types
        assigned: dict[str, Assigned] = {}
        nodes = (node for tree in trees if tree is not None for node in tree.walk())
        for node in filter(may_write, nodes):
            for name, place, field_type in self._written_by(node):
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
                first = assigned.get(name)
                if first is None:
                    line = place.position.line
                    assigned[name] = Assigned(type=field_type, node=node.key.text, line=line)
                elif first.type is not field_type:
                    assigned[name] = replace(first, type=FieldType.ANY)
        return assigned

    def below(self, raw: RawNode) -> set[str]:
        """Return the names that a node and all below it write."""
        return {name for node in filter(may_write, raw.walk()) for name in self.by(node)}

    def by(self, raw: RawNode) -> set[str]:
        """Return the names that a node writes itself."""
        return {name for name, _, _ in self._written_by(raw)}

    def _written_by(self, node: RawNode) -> Iterator[tuple[str, Scalar, FieldType]]:
        declared = self._declared(node)
        if declared is not None:
            entry = node.siblings.get("outputs")
            if entry is None:
                yield from ((one.name, node.key, one.type) for one in declared)
                return
            types = {one.name: one.type for one in declared}
            for item in entries_of(entry.value):
                source = item.value.text if isinstance(item.value, Scalar) else ""
                yield item.key.text, item.key, types.get(source, FieldType.ANY)
        elif node.type is None:
            return
        elif node.type.open:
            for item in entries_of(node.value):
                yield item.key.text, item.key, self._type_of(item.value)
        elif node.type.message is not None and isinstance(node.value, MappingNode):
            yield from self._message_outputs(node.type.message, node.value)

    def _type_of(self, node: Node) -> FieldType:
        match = ONE_NAME.fullmatch(node.text) if isinstance(node, Scalar) else None
        if match is None:
            return scalar_type(node)
        return self._types.get(match[1], FieldType.ANY)

    def _message_outputs(
        self, source: MessageSource, value: MappingNode
    ) -> Iterator[tuple[str, Scalar, FieldType]]:
        kind = source.kind
        named = value.get("type")
        type_name = named.text if isinstance(named, Scalar) else ""
        message = MessageFields(self._interfaces, kind, type_name, source.section)
        feedback = MessageFields(self._interfaces, kind, type_name, FEEDBACK)
        for item in entries_of(value.get("outputs")):
            path = item.value.text if isinstance(item.value, Scalar) else ""
            fields, prefix = message, source.prefix
            if kind is BindingKind.ACTION and path.startswith(f"{FEEDBACK}."):
                fields, prefix = feedback, FEEDBACK
            yield item.key.text, item.key, fields.type_of(path.removeprefix(f"{prefix}."))

    def _declared(self, node: RawNode) -> tuple[FieldSpec, ...] | None:
        """Return the outputs of a skill or subtree; None for other nodes."""
        if node.skill is not None:
            return node.skill.outputs
        if node.type is None or "outputs" not in node.type.siblings:
            return None
        if not isinstance(node.value, Scalar):
            return None
        called = self._subtrees.get(node.value.text)
        return called.outputs if called is not None else ()


def may_write(node: RawNode) -> bool:
    """Return whether a node may give names values: most give none."""
    if node.skill is not None:
        return bool(node.skill.outputs) or "outputs" in node.siblings
    return node.type is not None and node.type.writes
