# SPDX-License-Identifier: Apache-2.0
"""Records of a tree, in the studio's form."""

from __future__ import annotations

import time

from bt_agents_studio.records import NodeRecord, TreeNodeRecord, TreeRecord
from studio_entries import HOST


def node(path: str, parent: int, kind: str, name: str) -> TreeNodeRecord:
    """Return a node of a tree; ``parent`` is its index in the list, -1 for a root."""
    return TreeNodeRecord(
        path=path, parent=parent, kind=kind, name=name, file="a.yaml", line=1, column=1
    )


def large_tree(agent: str, groups: int, leaves: int) -> TreeRecord:
    """Return a root with groups of leaves."""
    nodes = [node("tree", -1, "selector", "everything")]
    for group in range(groups):
        parent = len(nodes)
        path = f"tree/{group}.sequence"
        nodes.append(node(path, 0, "sequence", f"group {group}"))
        nodes += [
            node(f"{path}/{leaf}.say", parent, "say", f"sentence {group} {leaf} to somebody")
            for leaf in range(leaves)
        ]
    return TreeRecord(agent=agent, host=HOST, nodes=tuple(nodes))


def status(name: str, message: str = "", since_s: float | None = None) -> NodeRecord:
    """Return the state of a node, since now or an earlier moment."""
    return NodeRecord(
        **dict.fromkeys(("starts", "successes", "failures"), 1),
        status=name,
        message=message,
        since_s=time.time() if since_s is None else since_s,
        tick=1,
        reason=message,
    )
