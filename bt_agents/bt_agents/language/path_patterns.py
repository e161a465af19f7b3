# SPDX-License-Identifier: Apache-2.0
"""Wildcards over the paths of a tree's nodes, as tests write them: ``tree/*.ask``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache

from bt_agents.language.specs import AgentSpec, NodeSpec

_PIECE = re.compile(r"\*\*/|\*\*|\*|[^*]+")
_MEANING = {"**/": "(?:.*/)?", "**": ".*", "*": "[^/]*"}


def is_path(text: str) -> bool:
    """Return whether a text is meant as a path or pattern and not as the name of a skill."""
    return "/" in text or "*" in text or text in ("tree", "on_cancel")


def matches(pattern: str, path: str) -> bool:
    """Return whether a path fits a pattern.

    ``*`` stands for anything inside one part of the path, ``**`` for any number of parts.
    """
    return _compiled(pattern).fullmatch(path) is not None


@lru_cache(maxsize=1024)
def _compiled(pattern: str) -> re.Pattern[str]:
    pieces = _PIECE.findall(pattern)
    return re.compile("".join(_MEANING.get(piece) or re.escape(piece) for piece in pieces))


def nodes_of(agent: AgentSpec) -> Iterator[NodeSpec]:
    """Return all nodes of an agent's trees, parents before children."""
    for root in (agent.tree, agent.on_cancel):
        if root is not None:
            yield from below(root)


def below(root: NodeSpec) -> Iterator[NodeSpec]:
    """Return a node and all nodes below it, parents before children."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed(node.children)
