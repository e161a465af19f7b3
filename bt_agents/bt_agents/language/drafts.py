# SPDX-License-Identifier: Apache-2.0
"""The structure of a tree as written: which key is the node, which ones modify it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from bt_agents.language.diagnostics import did_you_mean, shown
from bt_agents.language.nodes import BESIDE, KINDS, MODIFIERS, Children, NodeKind
from bt_agents.language.shape import FileReading, found
from bt_agents.language.specs import SkillSpec
from bt_agents.language.yaml_reader import Entry, Node, Scalar, Sequence
from bt_agents.language.yaml_reader import Mapping as MappingNode

_MAX_LABEL = 64


@dataclass(frozen=True, kw_only=True)
class Draft:
    """One node as written, its values not read yet.

    Attributes:
        key: The node key.
        value: What stands behind it.
        kind: Entry of the table of nodes; None for a skill.
        skill: Set for a skill.
        name: Name for people; empty when none is written.
        modifiers: Modifier entries by key.
        handler: The node behind ``on_failure``.
        inputs: What stands behind ``with``.
        options: Fields of a composite.
        children: In order.
    """

    key: Scalar
    value: Node
    kind: NodeKind | None
    skill: SkillSpec | None
    name: str = ""
    modifiers: Mapping[str, Entry] = field(default_factory=dict)
    handler: Draft | None = None
    inputs: Entry | None = None
    options: Mapping[str, Entry] = field(default_factory=dict)
    children: tuple[Draft, ...] = ()

    def walk(self) -> Iterator[Draft]:
        """Return this node and all below it, handlers included."""
        yield self
        for child in self.children:
            yield from child.walk()
        if self.handler is not None:
            yield from self.handler.walk()


def read_draft(
    reading: FileReading, node: Node, skills: Mapping[str, SkillSpec], where: str
) -> Draft | None:
    """Return the structure of a node; None when it is none, which is then reported.

    Args:
        reading: The file.
        node: What is written.
        skills: Skills by name.
        where: What the node is for, for messages: ``the tree``.
    """
    if not isinstance(node, MappingNode) or not node.entries:
        _not_a_node(reading, node, skills, where)
        return None
    nodes = [e for e in node.entries if e.key.text in KINDS or e.key.text in skills]
    others = [e for e in node.entries if e not in nodes]
    unknown = [e for e in others if e.key.text not in MODIFIERS and e.key.text not in BESIDE]
    if not nodes:
        _no_node(reading, node, unknown, skills)
        return None
    for extra in nodes[1:]:
        reading.error(
            "two-nodes",
            extra.key,
            f"two nodes in one item: '{nodes[0].key.text}' and '{extra.key.text}'",
            "indent the block, or start a new '-' item",
        )
    for entry in unknown:
        _unknown_beside(reading, entry, nodes[0], skills)
    entry = nodes[0]
    kind = KINDS.get(entry.key.text)
    known = {e.key.text: e for e in others if e not in unknown}
    inputs = known.pop("with", None)
    label = known.pop("name", None)
    handler = known.get("on_failure")
    if inputs is not None and entry.key.text != "subtree":
        reading.error(
            "misplaced-key",
            inputs.key,
            f"'with' gives inputs to a subtree, but this is '{entry.key.text}'",
            f"write the fields behind '{entry.key.text}:' as {{ … }}",
        )
    options, children = _children(reading, entry, kind, skills)
    return Draft(
        key=entry.key,
        value=entry.value,
        kind=kind,
        skill=None if kind is not None else skills[entry.key.text],
        name=_label(reading, label),
        modifiers=known,
        handler=(
            read_draft(reading, handler.value, skills, "'on_failure'")
            if handler is not None
            else None
        ),
        inputs=inputs,
        options=options,
        children=children,
    )


def _children(
    reading: FileReading, entry: Entry, kind: NodeKind | None, skills: Mapping[str, SkillSpec]
) -> tuple[dict[str, Entry], tuple[Draft, ...]]:
    if kind is None or kind.children is not Children.LIST:
        return {}, ()
    listed: Node = entry.value
    options: dict[str, Entry] = {}
    if isinstance(listed, MappingNode):
        if _is_node(listed, skills):
            reading.error(
                "wrong-type",
                listed.entries[0].key,
                f"'{kind.key}' needs a list of nodes, found a single node",
                "start each child with '- '",
            )
            return {}, ()
        fields = reading.fields(
            listed,
            f"'{kind.key}'",
            ["children", *(one.name for one in kind.fields)],
            ["children"],
        )
        assert fields is not None
        written = fields.get("children")
        if written is None:
            return {}, ()
        options = {e.key.text: e for e in listed.entries if e.value is not written}
        listed = written
    if not isinstance(listed, Sequence):
        reading.wrong_type(listed, f"the children of '{kind.key}'", "a list of nodes")
        return options, ()
    if not listed.items:
        reading.error("no-children", listed, f"'{kind.key}' has no children", "add a '-' item")
    drafts = (read_draft(reading, item, skills, f"'{kind.key}'") for item in listed.items)
    return options, tuple(draft for draft in drafts if draft is not None)


def _is_node(mapping: MappingNode, skills: Mapping[str, SkillSpec]) -> bool:
    return any(e.key.text in KINDS or e.key.text in skills for e in mapping.entries)


def _label(reading: FileReading, entry: Entry | None) -> str:
    text = reading.text(entry.value, "'name'") if entry is not None else None
    if entry is None or text is None:
        return ""
    if len(text) > _MAX_LABEL or "\n" in text:
        reading.error(
            "bad-name",
            entry.value,
            f"the name of a node is one line of at most {_MAX_LABEL} characters",
            "shorten it",
        )
    return text


def _not_a_node(
    reading: FileReading, node: Node, skills: Mapping[str, SkillSpec], where: str
) -> None:
    if isinstance(node, Scalar) and node.empty:
        message = f"nothing is written here, expected a node for {where}"
        reading.error("missing-value", node, message, "write one, for example 'say: Hello.'")
        return
    hint = "a node is a key with its value, for example 'say: Hello.'"
    if isinstance(node, Scalar):
        word, _, rest = node.text.partition(" ")
        if word.rstrip(":") in KINDS or word.rstrip(":") in skills:
            hint = f"write '{word.rstrip(':')}: {rest[:30] or '…'}', a ': ' between the two"
        elif node.text.startswith("${"):
            hint = "names stand in the fields of a node"
    elif isinstance(node, Sequence):
        hint = "write 'sequence:' above the list, and indent the list below it"
    message = f"{where} needs a node, found {found(node)}"
    reading.error("not-a-node", node, message, hint)


def _no_node(
    reading: FileReading,
    node: MappingNode,
    unknown: list[Entry],
    skills: Mapping[str, SkillSpec],
) -> None:
    if not unknown:
        first = node.entries[0].key
        reading.error(
            "no-node",
            first,
            f"'{first.text}' modifies a node, but there is no node beside it",
            "indent it like the key of its node, without a '-' of its own",
        )
        return
    for entry in unknown:
        reading.error(
            "unknown-node",
            entry.key,
            f"there is no node or skill {shown(entry.key.text)}",
            did_you_mean(entry.key.text, [*KINDS, *skills, *MODIFIERS]),
        )


def _unknown_beside(
    reading: FileReading, entry: Entry, node: Entry, skills: Mapping[str, SkillSpec]
) -> None:
    word = entry.key.text
    field_names = (
        [one.name for one in skills[node.key.text].inputs]
        if node.key.text in skills
        else [one.name for one in KINDS[node.key.text].fields]
    )
    if word in field_names or word == "children":
        hint = f"it belongs to '{node.key.text}': indent it below, or write both inside {{ … }}"
    else:
        hint = did_you_mean(word, [*MODIFIERS, *BESIDE])
    reading.error(
        "unknown-key", entry.key, f"there is no modifier {shown(word)} beside a node", hint
    )
