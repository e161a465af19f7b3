# SPDX-License-Identifier: Apache-2.0
"""Wildcards over the paths of a tree's nodes, as tests write them: ``tree/*.ask``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache

from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.model.specs import AgentSpec, NodeSpec, iter_nodes
from bt_agents_language.nodes.random import RANDOM
from bt_agents_language.nodes.weight import WEIGHT

_PIECE = re.compile(r"\*\*/|\*\*|\*|[^*]+")
_MEANING = {"**/": "(?:.*/)?", "**": ".*", "*": "[^/]*"}


def is_path(text: str) -> bool:
    """Return whether a text is meant as a path or pattern and not as the name of a skill."""
    return "/" in text or "*" in text or text in ("tree", "on_cancel")


def matches(pattern: str, path: str) -> bool:
    """Return whether a path fits a pattern.

    ``*`` matches anything inside one part of the path, ``**`` any number of parts.
    """
    return _compiled(pattern).fullmatch(path) is not None


def path_hint(text: str, known: Sequence[str]) -> str:
    """Return a hint for an unknown path: a child of its longest known part."""
    parts = text.split("/")
    for depth in range(len(parts) - 1, 0, -1):
        start = "/".join(parts[:depth])
        inside = [path for path in known if path.startswith(f"{start}/")]
        children = [path for path in inside if path.count("/") == depth]
        if not children:
            continue
        upto = f"{start}/{parts[depth]}"
        if "." in parts[depth]:
            return did_you_mean(upto, children)
        # Without its kind, 'tree/1' for 'tree/1.say', a part is clear by its number or not at all.
        numbered = [path for path in children if path.startswith(f"{upto}.")]
        return did_you_mean(upto, numbered) if numbered else did_you_mean("", children)
    return did_you_mean(text, known)


@lru_cache(maxsize=1024)
def _compiled(pattern: str) -> re.Pattern[str]:
    pieces = _PIECE.findall(pattern)
    return re.compile("".join(_MEANING.get(piece) or re.escape(piece) for piece in pieces))


def branches_of(node: NodeSpec) -> tuple[str, ...]:
    """Return the paths of the children of a ``random`` in order; none for other nodes."""
    if node.kind != RANDOM.key:
        return ()
    return tuple(child.path.removesuffix(f"@{WEIGHT.key}") for child in node.children)


def nodes_of(agent: AgentSpec) -> Iterator[NodeSpec]:
    """Return all nodes of an agent's trees, parents before children."""
    for root in (agent.tree, agent.on_cancel):
        if root is not None:
            yield from iter_nodes(root)
