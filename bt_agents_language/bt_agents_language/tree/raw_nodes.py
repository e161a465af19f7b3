# SPDX-License-Identifier: Apache-2.0
"""Raw nodes of a tree: the key of each node, and the keys next to it."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping

from bt_agents_core.text import ellipsize, join_quoted, quote
from bt_agents_language.diagnostics.collection import did_you_mean, nearest
from bt_agents_language.expression.quantities import COMMENT
from bt_agents_language.model.specs import NOTHING
from bt_agents_language.nodes.catalogue import DECORATORS, SIBLING_KEYS, SIBLINGS
from bt_agents_language.nodes.node_type import Children, Content, NodeType, RawNode
from bt_agents_language.nodes.skill import SKILL
from bt_agents_language.nodes.subtree import SUBTREE
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.typed_reader import Shape, TypedReader, found
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar, Sequence

_MAX_LABEL = 64
_PLAIN_WORDS = re.compile(r"[^\W\d_](?:[\w ,!?'-]|\.(?!\w))*")
_SIBLING_KEYS = frozenset(SIBLING_KEYS)
_FLAGS = frozenset(one.key for one in DECORATORS.values() if not (one.fields or one.handler))
_HANDLERS = tuple(one.key for one in DECORATORS.values() if one.handler)
_CONTRARIES = tuple((one.key, one.contrary) for one in DECORATORS.values() if one.contrary)
_COMMENT = "write a comment, a line that starts with '#'"
_CONDITION = "write its node itself here, and the condition as 'when: …' beside that"
_END = (
    "'check: false' fails here, 'fail: true' beside a node fails after it; a run ends "
    "with its tree"
)
_NEXT = "write both nodes in a 'sequence': the next one starts after a success"
_PAUSE = "write 'wait: …' as a node of its own"
_OTHER_LANGUAGES = {
    "if": "write 'when: …' beside a node, or use 'choose' for several cases",
    **dict.fromkeys(("then", "do"), _CONDITION),
    "else": "use 'choose' with 'otherwise'",
    "unless": "write 'when: not (…)' beside the node",
    "switch": "use 'choose' with named cases",
    "case": "use 'choose' with named cases",
    "otherwise": "'otherwise' stands beside 'children' in 'choose: {children: …, otherwise: …}'",
    "loop": "write 'repeat: …' beside the node",
    "for": "write 'repeat: …' beside the node",
    "until": "write 'repeat: {until: …}' beside the node",
    "goto": "there are no jumps: use 'choose', or call a subtree by its name",
    **dict.fromkeys(("elif", "elseif", "else_if"), "give 'choose' one more case"),
    **dict.fromkeys(("inverter", "not"), "write 'invert: true' beside the node"),
    **dict.fromkeys(("force_success", "always_succeed"), "write 'succeed: true' beside the node"),
    **dict.fromkeys(("force_failure", "always_fail"), "write 'fail: true' beside the node"),
    **dict.fromkeys(("stop", "cancel", "end", "exit", "return"), _END),
    **dict.fromkeys(("delay", "pause", "sleep"), _PAUSE),
    **dict.fromkeys(("on_success", "after"), _NEXT),
    "finally": "write 'succeed: true' beside the node, and the other one next in a 'sequence'",
    "every": "write 'repeat: {times: forever, pause: …}' beside the node",
    **dict.fromkeys(("comment", "description", "note"), _COMMENT),
}
"""Words of other languages → the equivalent here."""


class RawNodeReader:
    """Reader of the structure of one file's trees into raw nodes."""

    def __init__(
        self, reading: TypedReader, symbols: SymbolTable, subtrees: Collection[str] = ()
    ) -> None:
        self._reading = reading
        self._subtrees = subtrees
        self._skills = symbols.skills
        self._types = symbols.node_types
        self._words = {*symbols.node_types, *symbols.skills}
        self._incomplete = symbols.incomplete

    def read(self, node: Node, where: str, parent: NodeType | None = None) -> RawNode | None:
        """Return the structure of a node, or report that it is not one and return None."""
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
            elif word in _SIBLING_KEYS:
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
        return self._raw_node(nodes[0], nodes[0].key.text, known, parent, loose_children=loose)

    def _raw_node(
        self,
        entry: MappingEntry,
        word: str,
        known: dict[str, MappingEntry],
        parent: NodeType | None,
        loose_children: bool = False,
    ) -> RawNode:
        node_type = self._types.get(word)
        skill = None if node_type is not None else self._skills[word]
        label = known.pop("name", None)
        siblings: dict[str, MappingEntry] = {}
        if known:
            siblings = {key: known.pop(key) for key in SIBLINGS if key in known}
        if siblings:
            self._check_siblings(siblings, word, node_type, parent)
        if parent is not None and parent.child_keys:
            self._check_child_keys(entry, known, label, parent)
        options: dict[str, MappingEntry] = {}
        children: tuple[RawNode, ...] = ()
        if not (loose_children and isinstance(entry.value, Scalar) and entry.value.empty):
            options, children = self._children(entry, node_type)
        nodes: dict[str, RawNode | None] = {}
        if options and node_type is not None:
            nodes = {
                one.name: self.read(options[one.name].value, f"'{one.name}'")
                for one in node_type.fields
                if one.content is Content.NODE and one.name in options
            }
        if known:
            self._refuse_contradiction(known)
        for key in _HANDLERS:
            if key in known:
                nodes[key] = self.read(known[key].value, f"'{key}'")
        return RawNode(
            key=entry.key,
            value=entry.value,
            type=node_type,
            skill=skill,
            name=self._label(label) if label is not None else "",
            decorators=known,
            siblings=siblings,
            options=options,
            children=children,
            nodes={key: node for key, node in nodes.items() if node is not None}
            if nodes
            else NOTHING,
        )

    def _refuse_contradiction(self, known: Mapping[str, MappingEntry]) -> None:
        for key, contrary in _CONTRARIES:
            if key in known and contrary in known and _is_on(known, key, contrary):
                self._reading.error(
                    "contradiction",
                    known[contrary].key,
                    f"'{key}' and '{contrary}' stand beside the same node",
                    "keep the one that is meant",
                )
                return

    def _check_siblings(
        self,
        siblings: dict[str, MappingEntry],
        word: str,
        node_type: NodeType | None,
        parent: NodeType | None,
    ) -> None:
        allowed = (node_type or SKILL).siblings
        if parent is not None:
            allowed += parent.child_siblings
        for key in [key for key in siblings if key not in allowed]:
            entry = siblings.pop(key)
            fields = [one.name for one in node_type.fields] if node_type is not None else []
            hint = SIBLINGS[key].hint.format(node=word)
            if key in fields:
                hint = f"it belongs to '{word}': indent it below"
            self._reading.error(
                "misplaced-key",
                entry.key,
                f"'{key}' stands beside {SIBLINGS[key].where}, but this is '{word}'",
                hint,
            )

    def _check_child_keys(
        self,
        entry: MappingEntry,
        known: dict[str, MappingEntry],
        label: MappingEntry | None,
        parent: NodeType,
    ) -> None:
        written = {**known, **({"name": label} if label is not None else {})}
        missing = [key for key in parent.child_keys if key not in written]
        if missing:
            self._reading.error(
                "missing-key",
                entry.key,
                f"a case of '{parent.key}' needs the key{'s' * (len(missing) > 1)} "
                f"{join_quoted(missing)} beside its node",
                parent.child_keys[missing[-1]],
            )

    def _children(
        self, entry: MappingEntry, node_type: NodeType | None
    ) -> tuple[dict[str, MappingEntry], tuple[RawNode, ...]]:
        if node_type is None or node_type.children is not Children.LIST:
            return {}, ()
        word = node_type.key
        written: Node = entry.value
        options: dict[str, MappingEntry] = {}
        if isinstance(written, MappingNode) and written.entries:
            if any(e.key.text in self._words for e in written.entries):
                self._reading.error(
                    "wrong-type",
                    written.entries[0].key,
                    f"'{word}' needs a list of nodes, found a single node",
                    "start each child with '- '",
                )
                return {}, ()
            known = ["children", *(one.name for one in node_type.fields)]
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
                written, f"'{word}'", known, ["children"], beside=SIBLING_KEYS
            )
            if fields is None:
                return {}, ()
            options = {e.key.text: e for e in written.entries if e.key.text in known[1:]}
            children = fields.get("children")
            if children is None:
                return options, ()
            written = children
        items = written.items if isinstance(written, Sequence) else ()
        if isinstance(written, Scalar) or (isinstance(written, MappingNode) and written.entries):
            self._reading.wrong_type(
                written, f"the children of '{word}'", "a list of nodes", Shape.LIST
            )
        elif not items:
            self._reading.error(
                "no-children", written, f"'{word}' has no children", "add a '-' item"
            )
        nodes = [self.read(item, f"'{word}'", node_type) for item in items]
        return options, tuple([node for node in nodes if node is not None])

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
        return text.strip()

    def _not_a_node(self, node: Node, where: str) -> None:
        if isinstance(node, Scalar) and node.empty:
            message = f"nothing is written here, expected a node for {where}"
            self._reading.error(
                "missing-value", node, message, "write one, for example 'say: Hello.'"
            )
            return
        hint = "a node is a key with its value, for example 'say: Hello.'"
        if isinstance(node, Scalar):
            word = node.text.lower()
            meant = self._meant_pair(node.text) or _OTHER_LANGUAGES.get(word, "")
            if meant:
                hint = meant
            elif COMMENT.match(node.text):
                hint = "a comment starts with '#'"
            elif word in _FLAGS:
                hint = _alone(word, node)
            elif node.text.startswith("${"):
                hint = "names stand in the fields of a node"
            elif _PLAIN_WORDS.fullmatch(node.text) and "say" in self._skills:
                hint = f"to have it said, write 'say: {ellipsize(node.text)}'"
        elif isinstance(node, Sequence):
            hint = "write 'sequence:' above the list, and indent the list below it"
        message = f"{where} needs a node, found {found(node)}"
        self._reading.error("not-a-node", node, message, hint)

    def _meant_pair(self, text: str) -> str:
        """Return a hint for a node key and value that are not written in this form."""
        match = re.match(r"\s*([^\W\d]\w*)\s*([:\uff1a]?)(.*)", text, re.DOTALL)
        if match is None or match[1] not in self._words:
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
        """Report that there is no node; return the intended one, so that reading continues."""
        if not unknown:
            first = node.entries[0]
            self._reading.error(
                "no-node",
                first.key,
                f"'{first.key.text}' decorates a node, but there is no node beside it",
                _alone(first.key.text, first.value),
            )
            return None
        words = [*self._types, *self._skills]
        if self._incomplete and nearest(unknown[0].key.text, words) is None:
            return None
        elsewhere = any(entry.key.text.lower() in _OTHER_LANGUAGES for entry in unknown)
        for entry in unknown:
            self._reading.error(
                "unknown-node",
                entry.key,
                f"there is no node or skill {quote(entry.key.text)}",
                self._meant(entry) or did_you_mean(entry.key.text, [*words, *DECORATORS]),
            )
        if elsewhere:
            return None
        meant = nearest(unknown[0].key.text, words)
        if meant is None:
            children = unknown[0].value
            if isinstance(children, Sequence) and len(unknown) == 1:
                for item in children.items:
                    if isinstance(item, MappingNode):
                        self.read(item, where)
            return None
        known = {e.key.text: e for e in node.entries if e.key.text in _SIBLING_KEYS}
        return self._raw_node(unknown[0], meant, known, parent)

    def _meant(self, entry: MappingEntry) -> str:
        """Return a hint for a key that is not a node but has a known meaning."""
        text = entry.key.text
        word, colon, rest = text.partition(":")
        if colon and word in self._words:
            return f"write '{word}: {rest[:30]}', a space after the ':'"
        if text in self._subtrees:
            more = "" if isinstance(entry.value, Scalar) else ", and 'with: …' beside it"
            return f"it is a subtree: write 'subtree: {text}'{more}"
        return _OTHER_LANGUAGES.get(text.lower(), "")

    def _unknown_beside(self, entry: MappingEntry, node: MappingEntry) -> None:
        word, key = entry.key.text, node.key.text
        node_type = self._types.get(key)
        fields = node_type.fields if node_type is not None else self._skills[key].inputs
        if word in [one.name for one in fields] and isinstance(node.value, Sequence):
            hint = f"write '{key}: {{children: [ … ], {word}: … }}', the list under 'children:'"
        elif word in [one.name for one in fields] or word == "children":
            hint = f"it belongs to '{key}': indent it below, or write both inside {{ … }}"
        elif key == SUBTREE.key and word not in _OTHER_LANGUAGES:
            inputs = f"{{{word[:40]}: …}}" if isinstance(entry.value, Scalar) else "…"
            hint = f"write 'with: {inputs}' beside 'subtree'"
        else:
            other = _OTHER_LANGUAGES.get(word.lower())
            hint = other or did_you_mean(word, SIBLING_KEYS)
        self._reading.error(
            "unknown-key", entry.key, f"there is no decorator {quote(word)} beside a node", hint
        )


def _alone(word: str, value: Node) -> str:
    """Return a hint for a decorator without a node."""
    switch = f"'{word}: {'true' if word in _FLAGS else '…'}'"
    if isinstance(value, MappingNode):
        return f"write the node itself, and {switch} beside it"
    indented = "indent it like the key of its node, without a '-' of its own"
    if not isinstance(value, Scalar) or word not in _FLAGS:
        return indented
    if _PLAIN_WORDS.fullmatch(value.text) and value.text not in ("true", "false", word):
        return f"write 'say: {ellipsize(value.text)}', and {switch} beside it"
    check = {"fail": "write 'check: false' to fail here; or ", "succeed": "remove it, or "}
    return check.get(word, "") + indented


def _is_on(known: Mapping[str, MappingEntry], *switches: str) -> bool:
    values = [known[switch].value for switch in switches]
    return all(isinstance(value, Scalar) and value.text == "true" for value in values)
