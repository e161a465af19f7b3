# SPDX-License-Identifier: Apache-2.0
"""Fingerprints of trees without source positions, for fast comparison."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from hashlib import blake2b

from bt_agents_core.diagnostic import Position
from bt_agents_language.model.specs import NodeSpec, iter_nodes

_NOWHERE = Position(file="", line=1, column=1)


@dataclass(frozen=True, kw_only=True)
class TreeFingerprint:
    """Fingerprint of a tree: content, path and number of children of each node."""

    nodes: tuple[bytes, ...]
    places: tuple[tuple[str, int], ...]


def tree_fingerprint(tree: NodeSpec | None) -> TreeFingerprint:
    """Return the fingerprints of a tree; none for no tree."""
    specs = list(iter_nodes(tree)) if tree is not None else []
    return TreeFingerprint(
        nodes=tuple(_print(spec) for spec in specs),
        places=tuple((spec.path, len(spec.children)) for spec in specs),
    )


def difference(before: TreeFingerprint, after: TreeFingerprint) -> str:
    """Return in words how a tree has changed; empty if it behaves as before."""
    if before == after:
        return ""
    old, new = Counter(before.nodes), Counter(after.nodes)
    gone, come = (old - new).total(), (new - old).total()
    changed = min(gone, come)
    parts = [
        f"{number} node{'s' * (number != 1)} {word}"
        for number, word in (
            (changed, "changed"),
            (come - changed, "added"),
            (gone - changed, "removed"),
        )
        if number
    ]
    return ", ".join(parts) or "nodes in another order"


def _print(spec: NodeSpec) -> bytes:
    skill = replace(spec.skill, position=_NOWHERE) if spec.skill is not None else None
    bare = replace(spec, path="", position=_NOWHERE, children=(), skill=skill)
    return blake2b(repr(bare).encode(), digest_size=16).digest()
