# SPDX-License-Identifier: Apache-2.0
"""The order in which the formatter writes the keys of a tree's nodes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from bt_agents_language.model.node_type import Children
from bt_agents_language.nodes import BESIDE, KINDS, MODIFIERS
from bt_agents_language.yaml.yaml_reader import Mapping, MappingEntry, Node
from bt_agents_language.yaml.yaml_reader import Sequence as SequenceNode

_COMMENT_NEXT = re.compile(r"[ \t,]*#")
_ARGUMENTS = ("with", "outputs")
_RANKS = {
    word: rank
    for rank, word in enumerate(
        dict.fromkeys(
            (
                "name",
                *(word for word in BESIDE if word not in _ARGUMENTS),
                *_ARGUMENTS,
                *(word for word in MODIFIERS if word != "on_failure"),
                "on_failure",
            )
        )
    )
}


def ordered_nodes(
    root: Node, text: str, comments: Sequence[int]
) -> dict[tuple[int, int], tuple[MappingEntry, ...]]:
    """Return the entries of every tree node in the order in which they are to be written.

    ``name`` comes first. Modifiers stay on their side of the node key, in the order in which they
    nest; ``with`` and ``outputs`` come before them, and the handler ``on_failure`` last. A node
    where that would change the order of comments stays as it is.

    Args:
        root: The document.
        text: Of the file.
        comments: Index of every comment, rising.

    Returns:
        Span of the node's mapping → its entries.
    """
    return {node.span: _ordered(node, text, comments) for node in _tree_nodes(root)}


def _ordered(node: Mapping, text: str, comments: Sequence[int]) -> tuple[MappingEntry, ...]:
    entries = node.entries
    keys = [at for at, entry in enumerate(entries) if entry.key.text not in _RANKS]
    if len(keys) != 1:
        return entries
    before, after = entries[: keys[0]], entries[keys[0] + 1 :]
    names = [entry for entry in entries if entry.key.text == "name"]
    wanted = (
        *names,
        *sorted((e for e in before if e not in names), key=_rank),
        entries[keys[0]],
        *sorted((e for e in after if e not in names), key=_rank),
    )
    moved = [old for old, new in zip(entries, wanted, strict=True) if old is not new]
    if not moved:
        return entries
    start, end = moved[0].key.span[0], _end(moved[-1].value)
    if _COMMENT_NEXT.match(text, end) or any(start <= index < end for index in comments):
        return entries
    return wanted


def _rank(entry: MappingEntry) -> int:
    return _RANKS[entry.key.text]


def _end(node: Node) -> int:
    """Return where the last scalar or bracket of a value ends."""
    match node:
        case Mapping(entries=(*_, last)) if node.span[0] == last.key.span[0]:
            return _end(last.value)
    return node.span[1]


def _tree_nodes(root: Node) -> Iterator[Mapping]:
    """Return the nodes of all trees of a file, a node before those below it."""
    if not isinstance(root, Mapping):
        return
    yield from _nodes_below(filter(None, (root.get("tree"), root.get("on_cancel"))))
    subtrees = root.get("subtrees")
    for entry in subtrees.entries if isinstance(subtrees, Mapping) else ():
        if isinstance(entry.value, Mapping):
            yield from _nodes_below(filter(None, (entry.value.get("tree"),)))


def _nodes_below(nodes: Iterable[Node]) -> Iterator[Mapping]:
    for node in nodes:
        if not isinstance(node, Mapping):
            continue
        yield node
        for entry in node.entries:
            if entry.key.text == "on_failure":
                yield from _nodes_below((entry.value,))
            kind = KINDS.get(entry.key.text)
            if kind is not None and kind.children is Children.LIST:
                yield from _nodes_below(_children(entry.value))


def _children(value: Node) -> tuple[Node, ...]:
    if isinstance(value, SequenceNode):
        return value.items
    if not isinstance(value, Mapping):
        return ()
    listed = value.get("children")
    otherwise = value.get("otherwise")
    return (
        *(listed.items if isinstance(listed, SequenceNode) else ()),
        *((otherwise,) if otherwise is not None else ()),
    )
