# SPDX-License-Identifier: Apache-2.0
"""The structure of a tree as written: which key is the node, which ones modify it."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from bt_agents_language.model.node_type import Children, Content, NodeType
from bt_agents_language.model.specs import NOTHING, SkillSpec
from bt_agents_language.model.symbols import SymbolTable
from bt_agents_language.nodes import BESIDE, MODIFIERS, STANDS_BESIDE
from bt_agents_language.yaml.diagnostics import did_you_mean, nearest, shown
from bt_agents_language.yaml.typed_reader import TypedReader, found, listed
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar, Sequence

_MAX_LABEL = 64
_STANDS_BESIDE = frozenset(STANDS_BESIDE)
_CASE = ("name", "when")
_OTHER_LANGUAGES = {
    "if": "write 'when: …' beside a node, or use 'choose' for several cases",
    "else": "use 'choose' with 'otherwise'",
    "switch": "use 'choose' with named cases",
    "case": "use 'choose' with named cases",
    "otherwise": "'otherwise' stands beside 'children' in 'choose: {children: …, otherwise: …}'",
    "fallback": "did you mean 'selector'?",
    "loop": "write 'repeat: …' beside the node",
    "for": "write 'repeat: …' beside the node",
    "inverter": "write 'invert: true' beside the node",
}
"""Words of other languages → how the same is said here."""


@dataclass(slots=True, kw_only=True, eq=False)
class RawNode:
    """One node as written, its values not read yet.

    Attributes:
        key: The node key.
        value: What stands behind it.
        kind: Entry of the table of nodes; None for a skill.
        skill: Set for a skill.
        name: Name for people; empty when none is written.
        modifiers: Modifier entries by key.
        beside: The entries behind ``with``, ``outputs`` and ``weight``.
        options: Fields of a composite.
        children: In order.
        nodes: Nodes behind ``on_failure`` and in fields of a composite, by key.
    """

    key: Scalar
    value: Node
    kind: NodeType | None
    skill: SkillSpec | None
    name: str = ""
    modifiers: Mapping[str, MappingEntry] = field(default_factory=dict)
    beside: Mapping[str, MappingEntry] = field(default_factory=dict)
    options: Mapping[str, MappingEntry] = field(default_factory=dict)
    children: tuple[RawNode, ...] = ()
    nodes: Mapping[str, RawNode] = field(default_factory=dict)

    @property
    def word(self) -> str:
        """Name of the kind of node or skill; of a misspelt key the one that is meant."""
        if self.kind is not None:
            return self.kind.key
        return self.skill.name if self.skill is not None else self.key.text

    def walk(self) -> Iterator[RawNode]:
        """Return this node and all below it, handlers included."""
        waiting = [self]
        while waiting:
            draft = waiting.pop()
            yield draft
            if draft.nodes:
                waiting += reversed([*draft.nodes.values()])
            if draft.children:
                waiting += reversed(draft.children)


class RawNodeReader:
    """Reads the structure of the trees of one file.

    Args:
        reading: The file.
        vocabulary: The words that are nodes.
        subtrees: Names of the subtrees that it can call.
    """

    def __init__(
        self, reading: TypedReader, vocabulary: SymbolTable, subtrees: Collection[str] = ()
    ) -> None:
        self._reading = reading
        self._subtrees = subtrees
        self._skills = vocabulary.skills
        self._kinds = vocabulary.kinds
        self._words = {*vocabulary.kinds, *vocabulary.skills}
        self._incomplete = vocabulary.incomplete

    def read(self, node: Node, where: str, parent: NodeType | None = None) -> RawNode | None:
        """Return the structure of a node; None when it is none, which is then reported.

        Args:
            node: What is written.
            where: What the node is for, for messages: ``the tree``.
            parent: Kind of the composite that it is a child of.
        """
        if not isinstance(node, MappingNode) or not node.entries:
            self._not_a_node(node, where)
            return None
        nodes: list[MappingEntry] = []
        unknown: list[MappingEntry] = []
        known: dict[str, MappingEntry] = {}
        for entry in node.entries:
            word = entry.key.text
            if word in self._words:
                nodes.append(entry)
            elif word in _STANDS_BESIDE:
                known[word] = entry
            else:
                unknown.append(entry)
        if not nodes:
            return self._no_node(node, unknown, where, parent)
        for extra in nodes[1:]:
            self._reading.error(
                "two-nodes",
                extra.key,
                f"two nodes in one item: '{nodes[0].key.text}' and '{extra.key.text}'",
                "indent the block, or start a new '-' item",
            )
        for entry in unknown:
            self._unknown_beside(entry, nodes[0])
        loose = bool(unknown) and any(entry.key.text == "children" for entry in unknown)
        return self._draft(nodes[0], nodes[0].key.text, known, parent, loose_children=loose)

    def _is_word(self, text: str) -> bool:
        return text in self._words

    def _draft(
        self,
        entry: MappingEntry,
        word: str,
        known: dict[str, MappingEntry],
        parent: NodeType | None,
        loose_children: bool = False,
    ) -> RawNode:
        """Return the draft of a node.

        Args:
            entry: The node key and its value.
            word: The node key that is meant.
            known: The modifiers and other known keys beside it.
            parent: Kind of the composite that it is a child of.
            loose_children: Whether the children stand beside the node by mistake.
        """
        kind = self._kinds.get(word)
        skill = None if kind is not None else self._skills[word]
        label = known.pop("name", None)
        beside: dict[str, MappingEntry] = {}
        if known:
            beside = {key: known.pop(key) for key in BESIDE if key in known}
        if beside:
            self._check_beside(beside, word, kind, parent)
        if parent is not None and parent.key == "choose":
            self._check_case(entry, known, label)
        options: dict[str, MappingEntry] = {}
        children: tuple[RawNode, ...] = ()
        if not (loose_children and isinstance(entry.value, Scalar) and entry.value.empty):
            options, children = self._children(entry, kind)
        nodes: dict[str, RawNode | None] = {}
        if options and kind is not None:
            nodes = {
                one.name: self.read(options[one.name].value, f"'{one.name}'")
                for one in kind.fields
                if one.content is Content.NODE and one.name in options
            }
        if "succeed" in known and "fail" in known and _is_on(known, "succeed", "fail"):
            self._reading.error(
                "contradiction",
                known["fail"].key,
                "'succeed' and 'fail' stand beside the same node",
                "keep the one that is meant",
            )
        handler = known.get("on_failure")
        if handler is not None:
            nodes["on_failure"] = self.read(handler.value, "'on_failure'")
        return RawNode(
            key=entry.key,
            value=entry.value,
            kind=kind,
            skill=skill,
            name=self._label(label) if label is not None else "",
            modifiers=known,
            beside=beside,
            options=options,
            children=children,
            nodes={key: node for key, node in nodes.items() if node is not None}
            if nodes
            else NOTHING,
        )

    def _check_beside(
        self,
        beside: dict[str, MappingEntry],
        word: str,
        kind: NodeType | None,
        parent: NodeType | None,
    ) -> None:
        fits = {
            "with": word == "subtree",
            "outputs": word == "subtree" or kind is None,
            "weight": parent is not None and parent.key == "random",
        }
        for key in [key for key in beside if not fits[key]]:
            entry = beside.pop(key)
            fields = [one.name for one in kind.fields] if kind is not None else []
            hint = "remove it"
            if key in fields:
                hint = f"it belongs to '{word}': indent it below"
            elif key == "with":
                hint = f"write the fields behind '{word}:' as {{ … }}"
            elif key == "weight":
                hint = "put the node among the children of 'random', or remove it"
            self._reading.error(
                "misplaced-key",
                entry.key,
                f"'{key}' stands beside {BESIDE[key].where}, but this is '{word}'",
                hint,
            )

    def _check_case(
        self, entry: MappingEntry, known: dict[str, MappingEntry], label: MappingEntry | None
    ) -> None:
        written = {**known, **({"name": label} if label is not None else {})}
        missing = [key for key in _CASE if key not in written]
        if missing:
            self._reading.error(
                "missing-key",
                entry.key,
                f"a case of 'choose' needs the key{'s' * (len(missing) > 1)} {listed(missing)} "
                "beside its node",
                "the node for when no case fits goes under 'otherwise:'"
                if "when" in missing
                else "add 'name: …'",
            )

    def _children(
        self, entry: MappingEntry, kind: NodeType | None
    ) -> tuple[dict[str, MappingEntry], tuple[RawNode, ...]]:
        if kind is None or kind.children is not Children.LIST:
            return {}, ()
        word = kind.key
        written: Node = entry.value
        options: dict[str, MappingEntry] = {}
        if isinstance(written, MappingNode):
            if any(self._is_word(e.key.text) for e in written.entries):
                self._reading.error(
                    "wrong-type",
                    written.entries[0].key,
                    f"'{word}' needs a list of nodes, found a single node",
                    "start each child with '- '",
                )
                return {}, ()
            known = ["children", *(one.name for one in kind.fields)]
            if not any(e.key.text in known for e in written.entries) and all(
                isinstance(e.value, MappingNode) for e in written.entries
            ):
                first = written.entries[0].key
                self._reading.error(
                    "wrong-type",
                    first,
                    f"'{word}' needs a list of nodes, found a mapping",
                    f"start each one with '- name: {first.text[:30]}'",
                )
                return {}, ()
            fields = self._reading.fields(
                written, f"'{word}'", known, ["children"], beside=STANDS_BESIDE
            )
            if fields is None:
                return {}, ()
            options = {e.key.text: e for e in written.entries if e.key.text in known[1:]}
            children = fields.get("children")
            if children is None:
                return options, ()
            written = children
        if not isinstance(written, Sequence):
            self._reading.wrong_type(written, f"the children of '{word}'", "a list of nodes")
            return options, ()
        if not written.items:
            self._reading.error(
                "no-children", written, f"'{word}' has no children", "add a '-' item"
            )
        drafts = [self.read(item, f"'{word}'", kind) for item in written.items]
        return options, tuple([draft for draft in drafts if draft is not None])

    def _label(self, entry: MappingEntry) -> str:
        text = self._reading.text(entry.value, "'name'")
        if text is None:
            return ""
        if len(text) > _MAX_LABEL or "\n" in text:
            self._reading.error(
                "bad-name",
                entry.value,
                f"the name of a node is one line of at most {_MAX_LABEL} characters",
                "shorten it",
            )
        elif "${" in text:
            self._reading.error(
                "bad-name",
                entry.value,
                "the name of a node is always the same, so no ${…} can stand in it",
                "write plain words",
            )
        return text

    def _not_a_node(self, node: Node, where: str) -> None:
        if isinstance(node, Scalar) and node.empty:
            message = f"nothing is written here, expected a node for {where}"
            self._reading.error(
                "missing-value", node, message, "write one, for example 'say: Hello.'"
            )
            return
        hint = "a node is a key with its value, for example 'say: Hello.'"
        if isinstance(node, Scalar):
            meant = self._meant_pair(node.text)
            if meant:
                hint = meant
            elif node.text.startswith("${"):
                hint = "names stand in the fields of a node"
        elif isinstance(node, Sequence):
            hint = "write 'sequence:' above the list, and indent the list below it"
        message = f"{where} needs a node, found {found(node)}"
        self._reading.error("not-a-node", node, message, hint)

    def _meant_pair(self, text: str) -> str:
        """Return a hint for a node key and its value that are not written as such."""
        match = re.match(r"\s*([^\W\d]\w*)\s*([:\uff1a]?)(.*)", text, re.DOTALL)
        if match is None or not self._is_word(match[1]):
            return ""
        word, colon, rest = match.groups()
        strange = next((c for c in colon + rest[:1] if not c.isascii() and not c.isalpha()), "")
        name = unicodedata.name(strange, "an unusual character") if strange else ""
        more = f" ('{strange}' is {name})" if name else ""
        value = " ".join(rest.split())[:30] or "…"
        return f"write '{word}: {value}', a ': ' between the two{more}"

    def _no_node(
        self, node: MappingNode, unknown: list[MappingEntry], where: str, parent: NodeType | None
    ) -> RawNode | None:
        """Report that there is no node; return the one that was meant, so that it is read on."""
        if not unknown:
            first = node.entries[0]
            inside = isinstance(first.value, MappingNode)
            self._reading.error(
                "no-node",
                first.key,
                f"'{first.key.text}' modifies a node, but there is no node beside it",
                f"write the node itself, and '{first.key.text}: …' beside it"
                if inside
                else "indent it like the key of its node, without a '-' of its own",
            )
            return None
        words = [*self._kinds, *self._skills]
        if self._incomplete and nearest(unknown[0].key.text, words) is None:
            return None
        told = any(entry.key.text.lower() in _OTHER_LANGUAGES for entry in unknown)
        for entry in unknown[:1] if told else unknown:
            self._reading.error(
                "unknown-node",
                entry.key,
                f"there is no node or skill {shown(entry.key.text)}",
                self._meant(entry) or did_you_mean(entry.key.text, [*words, *MODIFIERS]),
            )
        if told:
            return None
        meant = nearest(unknown[0].key.text, words)
        if meant is None:
            children = unknown[0].value
            if isinstance(children, Sequence) and len(unknown) == 1:
                for item in children.items:
                    if isinstance(item, MappingNode):
                        self.read(item, where)
            return None
        known = {
            e.key.text: e for e in node.entries if e.key.text in MODIFIERS or e.key.text in BESIDE
        }
        return self._draft(unknown[0], meant, known, parent)

    def _meant(self, entry: MappingEntry) -> str:
        """Return a hint for a key that is no node but means something."""
        text = entry.key.text
        word, colon, rest = text.partition(":")
        if colon and self._is_word(word):
            return f"write '{word}: {rest[:30]}', a space behind the ':'"
        if text in self._subtrees:
            with_inputs = (
                ", and 'with: …' beside it" if not isinstance(entry.value, Scalar) else ""
            )
            return f"it is a subtree: write 'subtree: {text}'{with_inputs}"
        return _OTHER_LANGUAGES.get(text.lower(), "")

    def _unknown_beside(self, entry: MappingEntry, node: MappingEntry) -> None:
        word, key = entry.key.text, node.key.text
        kind = self._kinds.get(key)
        fields = kind.fields if kind is not None else self._skills[key].inputs
        if word in [one.name for one in fields] or word == "children":
            hint = f"it belongs to '{key}': indent it below, or write both inside {{ … }}"
        else:
            other = _OTHER_LANGUAGES.get(word.lower())
            hint = other or did_you_mean(word, STANDS_BESIDE)
        self._reading.error(
            "unknown-key", entry.key, f"there is no modifier {shown(word)} beside a node", hint
        )


def _is_on(known: Mapping[str, MappingEntry], *switches: str) -> bool:
    values = [known[switch].value for switch in switches]
    return all(isinstance(value, Scalar) and value.text == "true" for value in values)
