# SPDX-License-Identifier: Apache-2.0
"""Outcomes of the nodes of a checked tree, each as its type computes them."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_language.model.specs import Literal, NodeSpec, iter_nodes
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.endings import EITHER, Outcomes
from bt_agents_language.nodes.node_type import FOREVER, Role

_FOREVER = Literal(value=FOREVER)


def outcomes(spec: NodeSpec) -> Outcomes:
    """Return every way in which a node can go; a way too many where only a run shows it."""
    return every_outcome(list(iter_nodes(spec)))[id(spec)]


def every_outcome(nodes: Sequence[NodeSpec]) -> dict[int, Outcomes]:
    """Return every way in which each node of a tree can go; as :func:`outcomes`.

    Args:
        nodes: All nodes of a tree, parents before children.

    Returns:
        The ways by the identity of the node.
    """
    found: dict[int, Outcomes] = {}
    for spec in reversed(nodes):
        node_type = type_of(spec)
        if spec.children or node_type.role is Role.LEAF:
            children = [found[id(child)] for child in spec.children]
            found[id(spec)] = node_type.outcomes(spec, children)
        else:
            found[id(spec)] = EITHER
    return found


def endless(spec: NodeSpec) -> bool:
    """Return whether a node runs another one again and again, without a number."""
    rounds = type_of(spec).rounds
    return bool(rounds) and spec.fields.get(rounds) == _FOREVER
