# SPDX-License-Identifier: Apache-2.0
"""Conversion of raw nodes to checked ones, with values, decorators and paths."""

from __future__ import annotations

import re
from collections.abc import Mapping

from bt_agents_core.diagnostic import Position
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import NOTHING, Literal, NodeSpec, SubtreeSpec
from bt_agents_language.nodes.catalogue import DECORATORS
from bt_agents_language.nodes.endings import Outcome
from bt_agents_language.nodes.node_type import (
    Children,
    FieldValues,
    NodeType,
    RawNode,
    Wrap,
    short,
    wrapped,
)
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tree.assigned_names import AssignedNames, may_write
from bt_agents_language.tree.calls import CallReader
from bt_agents_language.tree.node_fields import FieldReader, written_fields
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Node

_NOT_IN_PATH = re.compile(r"[^\w-]+")


class TreeReader:
    """Reader of the trees in one file; a :class:`NodeReader` for their node types.

    Attributes:
        calls: Place of each ``subtree`` node read so far → name of the subtree.
        assigned: Names that each node assigns.
    """

    def __init__(
        self, reading: TypedReader, symbols: SymbolTable, subtrees: Mapping[str, SubtreeSpec]
    ) -> None:
        self.reading = reading
        self.interfaces = symbols.interfaces
        self._fields = FieldReader(reading, symbols)
        self._calls = CallReader(reading, subtrees, symbols)
        self.calls: Mapping[Position, str] = self._calls.calls
        self.assigned = AssignedNames(reading, subtrees, symbols.interfaces)

    def read(
        self, raw: RawNode, path: str, names: NameScope, *, parent: NodeType | None = None
    ) -> NodeSpec | None:
        """Return a node with everything below it, or report that it is wrong and return None.

        ``names`` records the names that it assigns; ``parent`` is the composite around it.
        """
        if not raw.decorators:
            spec = self._node(raw, path, names)
            if may_write(raw):
                names.give(self.assigned.by(raw))
            return spec
        part_of_parent = parent.child_keys if parent is not None else ()
        around = [
            one
            for one in DECORATORS.values()
            if one.key in raw.decorators and one.key not in part_of_parent
        ]
        if any(one.rounds for one in around):
            # A later round can use names that an earlier one has assigned.
            names.give(self.assigned.below(raw))
        wrapping = [
            None if one.handler else self._decorator_fields(one, raw, names, parent)
            for one in around
        ]
        spec = self._node(raw, path, names)
        names.give(self.assigned.by(raw))
        for one, fields in zip(reversed(around), reversed(wrapping), strict=True):
            entry = raw.decorators[one.key]
            if one.handler:
                spec = self._handled(one, raw, path, names, spec)
            elif fields is not None:
                label = f"{one.key} {short(entry.value)}" if one.fields else one.key
                spec = wrapped(spec, one.key, entry.key.position, path, fields, label)
        return spec

    def _decorator_fields(
        self, decorator: NodeType, raw: RawNode, names: NameScope, parent: NodeType | None
    ) -> FieldValues | None:
        """Return the fields of a decorator; None if it is switched off."""
        node = raw.decorators[decorator.key].value
        what = f"'{decorator.key}'"
        fields: FieldValues = {}
        if not decorator.fields:
            if not self.reading.boolean(node, what):
                return None
        else:
            main = decorator.main
            nodes = written_fields(self.reading, node, what, decorator.fields, main) or {}
            fields = self.values(decorator, nodes, names, what)
            if decorator.complete is not None:
                decorator.complete(self.reading, node, nodes, fields)
        if decorator.skips:
            continues_on = parent.continues_on if parent is not None else Outcome.SUCCESS
            fields["otherwise"] = Literal(value=continues_on.name.lower())
        return fields

    def _handled(
        self, decorator: NodeType, raw: RawNode, path: str, names: NameScope, spec: NodeSpec | None
    ) -> NodeSpec | None:
        written = raw.nodes.get(decorator.key)
        if written is None:
            return None
        here = f"{path}@{decorator.key}"
        handler = self.read(written, f"{here}/{_segment(0, written)}", names)
        if spec is None or handler is None:
            return None
        return NodeSpec(
            path=here,
            position=raw.decorators[decorator.key].key.position,
            kind=decorator.key,
            name=decorator.key,
            children=(spec, handler),
        )

    def _node(self, raw: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        if raw.skill is not None:
            return self._calls.skill(raw, path, names)
        assert raw.type is not None
        if raw.type.read is not None:
            return raw.type.read(self, raw, path, names)
        if raw.type.children is Children.LIST:
            return self.composite(raw, path, names)
        return self.leaf(raw, path, names)

    def subtree(self, raw: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        """Return a call of a subtree, before its expansion."""
        return self._calls.subtree(raw, path, names)

    def composite(
        self, raw: RawNode, path: str, names: NameScope, wrap: Wrap | None = None
    ) -> NodeSpec:
        """Return a composite with its children."""
        node_type = raw.type
        assert node_type is not None
        nodes = {name: entry.value for name, entry in raw.options.items()}
        fields = self.values(node_type, nodes, names)
        memory = fields.get("memory")
        again = isinstance(memory, Literal) and memory.value is False
        if node_type.concurrent or again:
            # Any child may run after any other.
            names.give(self.assigned.below(raw))
        own = len(raw.children)
        in_fields = [raw.nodes[one.name] for one in node_type.fields if one.name in raw.nodes]
        at_start = set(names.given) if node_type.exclusive else set()
        at_end = set(at_start)
        children: list[NodeSpec | None] = []
        for index, child in enumerate([*raw.children, *in_fields]):
            if node_type.exclusive:
                names.given.clear()
                names.given.update(at_start)
            here = f"{path}/{_segment(index, child)}"
            spec = self.read(child, here, names, parent=node_type if index < own else None)
            children.append(wrap(child, spec, here) if wrap is not None else spec)
            if node_type.exclusive:
                at_end |= names.given
        if node_type.exclusive:
            names.give(at_end)
        return NodeSpec(
            path=path,
            position=raw.key.position,
            kind=node_type.key,
            name=raw.name or node_type.key,
            fields=fields,
            children=tuple([child for child in children if child is not None]),
        )

    def written_fields(self, raw: RawNode) -> Mapping[str, Node] | None:
        """Return the written fields of a leaf by name; None if they are unreadable."""
        assert raw.type is not None
        what = f"'{raw.type.key}'"
        return written_fields(self.reading, raw.value, what, raw.type.fields, raw.type.main)

    def values(
        self, node_type: NodeType, nodes: Mapping[str, Node], names: NameScope, what: str = ""
    ) -> FieldValues:
        """Return the values of written fields, with defaults for the others."""
        return self._fields.read_all(node_type.fields, nodes, names, node_type.main, what)

    def leaf(
        self,
        raw: RawNode,
        path: str,
        names: NameScope,
        nodes: Mapping[str, Node] | None = None,
        label: Node | None = None,
    ) -> NodeSpec | None:
        """Return a leaf according to its fields."""
        node_type = raw.type
        assert node_type is not None
        if nodes is None:
            nodes = self.written_fields(raw)
        if nodes is None:
            return None
        first = node_type.main or (node_type.fields[0].name if node_type.fields else "")
        label = nodes.get(first) if label is None else label
        fields = self.values(node_type, nodes, names, f"'{node_type.key}'")
        outputs = NOTHING
        if node_type.message is not None:
            outputs = self._fields.outputs(nodes.get("outputs"), nodes)
        elif node_type.gives:
            outputs = {one.name: key for key, one in node_type.gives.items()}
        return NodeSpec(
            path=path,
            position=raw.key.position,
            kind=node_type.key,
            name=raw.name or f"{node_type.key} {short(label)}".rstrip(),
            fields=fields,
            outputs=outputs,
            plugin=node_type.plugin,
        )


def _segment(index: int, raw: RawNode) -> str:
    word = _NOT_IN_PATH.sub("_", raw.name).strip("_") if raw.name else ""
    return f"{index}.{word or raw.key.text}"
