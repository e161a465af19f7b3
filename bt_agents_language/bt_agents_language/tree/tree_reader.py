# SPDX-License-Identifier: Apache-2.0
"""Drafts turned into checked nodes: values read, modifiers wrapped around, paths given."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from bt_agents_language.model.node_type import Children, DecoratorType
from bt_agents_language.model.scope import NameScope
from bt_agents_language.model.specs import (
    FieldType,
    Literal,
    NodeSpec,
    Position,
    SubtreeSpec,
    Value,
)
from bt_agents_language.model.symbols import SymbolTable
from bt_agents_language.model.values import read_value
from bt_agents_language.nodes import FOREVER, MODIFIERS
from bt_agents_language.tree.assigned_names import AssignedNames, may_write
from bt_agents_language.tree.calls import LABEL_LENGTH, CallReader, short
from bt_agents_language.tree.child_counts import read_succeed_on, refuse_no_chance
from bt_agents_language.tree.node_fields import FieldReader, FieldValues, written_fields
from bt_agents_language.tree.raw_nodes import RawNode
from bt_agents_language.tree.ros_leaves import RAW_LEAVES, read_raw_leaf
from bt_agents_language.yaml.typed_reader import TypedReader, listed
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import Node, Scalar, entries_of

_NOT_IN_PATH = re.compile(r"[^\w-]+")
_LOOPS = ("retry", "repeat")
_LEFT_OUT = ("when", "once", "cooldown")
_EXCLUSIVE = ("choose", "random")


class TreeReader:
    """Reads the trees of one file.

    Args:
        reading: The file.
        vocabulary: What it may speak of.
        subtrees: What its trees can call, by name.
    """

    def __init__(
        self,
        reading: TypedReader,
        vocabulary: SymbolTable,
        subtrees: Mapping[str, SubtreeSpec],
    ) -> None:
        self._reading = reading
        self._interfaces = vocabulary.interfaces
        self._fields = FieldReader(reading, vocabulary)
        self._calls = CallReader(reading, subtrees, vocabulary)
        self._written = AssignedNames(reading, subtrees, vocabulary.interfaces)

    @property
    def calls(self) -> Mapping[Position, str]:
        """Place of each ``subtree`` node read so far → name of the subtree."""
        return self._calls.calls

    def read(
        self, draft: RawNode, path: str, names: NameScope, *, parent: str = ""
    ) -> NodeSpec | None:
        """Return a node with everything below it; None when it is wrong, which is then reported.

        Args:
            draft: The node as written.
            path: Its path.
            names: What its values and conditions may name; learns what the node writes.
            parent: Key of the composite that it is a child of.
        """
        if not draft.modifiers:
            spec = self._node(draft, path, names)
            if may_write(draft):
                names.give(self._written.by(draft))
            return spec
        if not draft.modifiers.keys().isdisjoint(_LOOPS):
            # A later round can use what an earlier one has written.
            names.give(self._written.below(draft))
        kinds = [kind for kind in MODIFIERS.values() if kind.key in draft.modifiers]
        wrapping = [
            None if kind.handler else self._modifier_fields(kind, draft, names, parent)
            for kind in kinds
        ]
        spec = self._node(draft, path, names)
        names.give(self._written.by(draft))
        for kind, fields in zip(reversed(kinds), reversed(wrapping), strict=True):
            entry = draft.modifiers[kind.key]
            if kind.handler:
                spec = self._handled(draft, entry.key.position, path, names, spec)
            elif fields is not None:
                label = f"{kind.key} {short(entry.value)}" if kind.fields else kind.key
                spec = _wrapped(spec, kind.key, entry.key.position, path, fields, label)
        return spec

    def _modifier_fields(
        self, kind: DecoratorType, draft: RawNode, names: NameScope, parent: str
    ) -> FieldValues | None:
        """Return the fields of a modifier; None when it is switched off or is part of a case."""
        node = draft.modifiers[kind.key].value
        what = f"'{kind.key}'"
        if kind.key == "when" and parent == "choose":
            return None
        fields: FieldValues = {}
        if not kind.fields:
            if not self._reading.boolean(node, what):
                return None
        else:
            nodes = written_fields(self._reading, node, what, kind.fields, kind.main) or {}
            fields = self._fields.read_all(kind.fields, nodes, names, kind.main, what)
            if kind.key == "repeat":
                self._check_repeat(node, nodes)
                fields.setdefault("times", Literal(value=FOREVER))
        if kind.key in _LEFT_OUT:
            # A selector goes on to its next child, everything else goes on.
            outcome = "failure" if parent == "selector" else "success"
            fields["otherwise"] = Literal(value=outcome)
        return fields

    def _check_repeat(self, node: Node, nodes: Mapping[str, Node]) -> None:
        empty = isinstance(node, Scalar) and node.empty
        if (empty or isinstance(node, MappingNode)) and not {"times", "until"} & nodes.keys():
            self._reading.error(
                "missing-key",
                node,
                "'repeat' needs the key 'times' or 'until'",
                "write how often, or what ends it: {until: answer == 'yes'}",
            )

    def _handled(
        self,
        draft: RawNode,
        position: Position,
        path: str,
        names: NameScope,
        spec: NodeSpec | None,
    ) -> NodeSpec | None:
        written = draft.nodes.get("on_failure")
        if written is None:
            return None
        here = f"{path}@on_failure"
        handler = self.read(written, f"{here}/{_segment(0, written)}", names)
        if spec is None or handler is None:
            return None
        return NodeSpec(
            path=here,
            position=position,
            kind="on_failure",
            name="on_failure",
            children=(spec, handler),
        )

    def _node(self, draft: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        if draft.skill is not None:
            return self._calls.skill(draft, path, names)
        assert draft.kind is not None
        if draft.kind.children is Children.LIST:
            return self._composite(draft, path, names)
        read = _LEAVES.get(draft.kind.key, TreeReader._leaf)
        return read(self, draft, path, names)

    def _subtree(self, draft: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        return self._calls.subtree(draft, path, names)

    def _composite(self, draft: RawNode, path: str, names: NameScope) -> NodeSpec:
        assert draft.kind is not None
        key = draft.kind.key
        nodes = {name: entry.value for name, entry in draft.options.items()}
        fields = self._fields.read_all(draft.kind.fields, nodes, names)
        memory = fields.get("memory")
        again = isinstance(memory, Literal) and memory.value is False
        if key == "parallel" or again:
            # Any child may run after any other.
            names.give(self._written.below(draft))
        if key == "parallel" and "succeed_on" in nodes:
            fields["succeed_on"] = Literal(
                value=read_succeed_on(self._reading, draft, nodes["succeed_on"])
            )
        listed_children = [*draft.children]
        if "otherwise" in draft.nodes:
            listed_children.append(draft.nodes["otherwise"])
        exclusive = key in _EXCLUSIVE
        at_start = set(names.given) if exclusive else set()
        at_end = set(at_start)
        whens = [self._case(child, names) for child in draft.children] if key == "choose" else []
        children: list[NodeSpec | None] = []
        for index, child in enumerate(listed_children):
            if exclusive:
                names.given.clear()
                names.given.update(at_start)
            here = f"{path}/{_segment(index, child)}"
            is_child = index < len(draft.children)
            spec = self.read(child, here, names, parent=key if is_child else "")
            if key == "choose":
                case = whens[index] if is_child else {}
                label = child.name or "otherwise"
                spec = _wrapped(spec, "case", child.key.position, here, case, label, "when")
            elif key == "random":
                weight = self._weight(child, names)
                label = f"weight {short(child.beside['weight'].value)}" if weight else "weight 1"
                one: FieldValues = {"weight": weight or Literal(value=1.0)}
                spec = _wrapped(spec, "weight", child.key.position, here, one, label)
            children.append(spec)
            if exclusive:
                at_end |= names.given
        if exclusive:
            names.give(at_end)
        if key == "random":
            refuse_no_chance(self._reading, draft, children)
        return NodeSpec(
            path=path,
            position=draft.key.position,
            kind=key,
            name=draft.name or key,
            fields=fields,
            children=tuple([child for child in children if child is not None]),
        )

    def _case(self, child: RawNode, names: NameScope) -> FieldValues:
        entry = child.modifiers.get("when")
        if entry is None:
            return {}
        nodes = {"condition": entry.value}
        return self._fields.read_all(MODIFIERS["when"].fields, nodes, names, "condition", "'when'")

    def _weight(self, child: RawNode, names: NameScope) -> Value | None:
        entry = child.beside.get("weight")
        if entry is None:
            return None
        return read_value(self._reading, entry.value, FieldType.NUMBER, names, "'weight'", 0.0)

    def _leaf(self, draft: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        kind = draft.kind
        assert kind is not None
        what = f"'{kind.key}'"
        nodes = written_fields(self._reading, draft.value, what, kind.fields, kind.main)
        if nodes is None:
            return None
        first = kind.main or (kind.fields[0].name if kind.fields else "")
        return NodeSpec(
            path=path,
            position=draft.key.position,
            kind=kind.key,
            name=draft.name or f"{kind.key} {short(nodes.get(first))}".rstrip(),
            fields=self._fields.read_all(kind.fields, nodes, names, kind.main, what),
            plugin=kind.behaviour,
        )

    def _wait_for(self, draft: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        kind = draft.kind
        assert kind is not None
        nodes = written_fields(self._reading, draft.value, "'wait_for'", kind.fields, kind.main)
        if nodes is None:
            return None
        message = [key for key in ("topic", "type", "until", "latched", "outputs") if key in nodes]
        missing = [key for key in ("topic", "type") if key not in nodes]
        if "condition" in nodes and message:
            self._reading.error(
                "misplaced-key",
                _key(draft.value, message[0]),
                f"'{message[0]}' is about a message, but this waits for a condition",
                "wait for the one or the other; 'parallel' waits for both",
            )
        elif "condition" not in nodes and missing:
            self._reading.error(
                "missing-key",
                draft.key,
                f"'wait_for' needs a condition, or the keys {listed(('topic', 'type'))}",
                "write wait_for: live.person, or add "
                + ", ".join(f"'{key}: …'" for key in missing),
            )
        shown_node = nodes.get("condition") or nodes.get("topic")
        return NodeSpec(
            path=path,
            position=draft.key.position,
            kind="wait_for",
            name=draft.name or f"wait_for {short(shown_node)}".rstrip(),
            fields=self._fields.read_all(kind.fields, nodes, names, kind.main, "'wait_for'"),
            outputs=self._fields.outputs(nodes.get("outputs"), nodes),
        )

    def _give_feedback(self, draft: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        spec = self._leaf(draft, path, names)
        kind = spec.fields.get("kind") if spec is not None else None
        if spec is None or not isinstance(kind, Literal):
            return spec
        values = draft.value.get("values") if isinstance(draft.value, MappingNode) else None
        if kind.value == "direct" and values is None:
            self._reading.error(
                "missing-key",
                draft.value,
                "direct feedback needs the values that the profile moves to",
                "write give_feedback: {kind: direct, values: {…}}",
            )
        elif kind.value != "direct" and values is not None:
            self._reading.error(
                "misplaced-key",
                _key(draft.value, "values"),
                f"{kind.value} feedback takes the scene, so it has no values of its own",
                "remove 'values', or write kind: direct",
            )
        return spec

    def _raw(self, draft: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        key = draft.word
        leaf = read_raw_leaf(self._reading, draft, RAW_LEAVES[key], names, self._interfaces)
        if leaf is None or leaf.binding is None:
            return None
        return NodeSpec(
            path=path,
            position=draft.key.position,
            kind=key,
            name=draft.name or f"{key} {leaf.binding.name}",
            skill=leaf,
            outputs=leaf.binding.outputs,
            feedback=leaf.binding.feedback,
        )

    def _set(self, draft: RawNode, path: str, names: NameScope) -> NodeSpec | None:
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
            name=draft.name or f"set {', '.join(fields)}"[:LABEL_LENGTH],
            fields=fields,
        )


_LEAVES: Mapping[str, Callable[[TreeReader, RawNode, str, NameScope], NodeSpec | None]] = {
    "set": TreeReader._set,
    "subtree": TreeReader._subtree,
    "wait_for": TreeReader._wait_for,
    "give_feedback": TreeReader._give_feedback,
    **dict.fromkeys(RAW_LEAVES, TreeReader._raw),
}


def _wrapped(
    spec: NodeSpec | None,
    kind: str,
    position: Position,
    path: str,
    fields: FieldValues,
    label: str,
    suffix: str = "",
) -> NodeSpec | None:
    if spec is None:
        return None
    return NodeSpec(
        path=f"{path}@{suffix or kind}",
        position=position,
        kind=kind,
        name=label,
        fields=fields,
        children=(spec,),
    )


def _key(node: Node, name: str) -> Node:
    """Return a key of a mapping as it stands in the file."""
    return next((entry.key for entry in entries_of(node) if entry.key.text == name), node)


def _segment(index: int, draft: RawNode) -> str:
    word = _NOT_IN_PATH.sub("_", draft.name).strip("_") if draft.name else ""
    return f"{index}.{word or draft.key.text}"
