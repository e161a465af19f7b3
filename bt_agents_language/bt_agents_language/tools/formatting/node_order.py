# SPDX-License-Identifier: Apache-2.0
"""Order in which the formatter writes the keys of a node."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES, SIBLINGS
from bt_agents_language.nodes.node_type import Children, Content, NodeType
from bt_agents_language.yaml.yaml_reader import Mapping, MappingEntry, Node
from bt_agents_language.yaml.yaml_reader import Sequence as SequenceNode

_COMMENT_NEXT = re.compile(r"[ \t,]*#")
_ARGUMENTS = ("with", "outputs")
_HANDLERS = tuple(one.key for one in DECORATORS.values() if one.handler)
_ORDER = (
    *(word for word in SIBLINGS if word not in _ARGUMENTS),
    *_ARGUMENTS,
    *(word for word in DECORATORS if word not in _HANDLERS),
    *_HANDLERS,
)


def ordered_nodes(
    root: Node, text: str, comments: Sequence[int]
) -> dict[tuple[int, int], tuple[MappingEntry, ...]]:
    """Return the entries of every tree node in the order in which they are to be written.

    ``name`` comes first. Decorators stay on their side of the node key, in the order in which they
    nest; ``with`` and ``outputs`` come before them, and the handler ``on_failure`` last. A node
    where that would change the order of comments, found by their indices, stays as it is.

    Returns:
        Span of the node's mapping → its entries.
    """
    return {node.span: _ordered(node, text, comments) for node in _tree_nodes(root)}


def _ordered(node: Mapping, text: str, comments: Sequence[int]) -> tuple[MappingEntry, ...]:
    entries = node.entries
    keys = [at for at, entry in enumerate(entries) if entry.key.text not in _ORDER]
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
    return _ORDER.index(entry.key.text)


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
            if entry.key.text in _HANDLERS:
                yield from _nodes_below((entry.value,))
            node_type = NODE_TYPES.get(entry.key.text)
            if node_type is not None and node_type.children is Children.LIST:
                yield from _nodes_below(_children(entry.value, node_type))


def _children(value: Node, node_type: NodeType) -> tuple[Node, ...]:
    if isinstance(value, SequenceNode):
        return value.items
    if not isinstance(value, Mapping):
        return ()
    listed = value.get("children")
    in_fields = [value.get(one.name) for one in node_type.fields if one.content is Content.NODE]
    return (
        *(listed.items if isinstance(listed, SequenceNode) else ()),
        *(node for node in in_fields if node is not None),
    )
